"""States of the rotors behind gears that give: how far each is ahead of its link, and how fast it runs away from it.

They stand behind the states of actuators, two for each gear, in the order of the effects. A servo holds its rotor
within a play; a plain motor throws it from end to end, and no tangent holds through blows that it deals: there it is
where its law has it along the motion (`gear_laws`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.gears import loose
from fimpact.smoothing.dynamics.gear_laws import Driven, shafts_of, turned
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States


def turning(track: Track, placed: Sequence[Placed]) -> tuple[Placed, ...]:
    """Those of `placed` that are gears of which the rotor has states of its own."""
    gears = (law for law in placed if law.effect.enters == "gear")
    return tuple(law for law in gears if law.effect.law is not loose or law.site in track.served)


def with_rotors(
    track: Track, states: States, had: Sequence[Placed], placed: Sequence[Placed], driven: Driven | None = None
) -> States:
    """`states`, (N,), with the rotors of gears in `placed`, in the place of those of gears in `had`.

    A rotor that is new is where its law has it along them, a link of which the gear gives no longer where its encoder
    is: readings of encoders stay as they were.

    Args:
        driven: what drives new ones, default: what the track has.
    """
    before, after = turning(track, had), turning(track, placed)
    if [law.name for law in before] == [law.name for law in after]:
        return states
    model, qpos, qvel = track.model, states.qpos.copy(), states.qvel.copy()
    known = {law.name: states.act[:, model.na + 2 * i :][:, :2] for i, law in enumerate(before)}
    new = [law for law in after if law.name not in known]
    for law in before:
        if law.name not in {own.name for own in after}:
            _shift(model, law.site, qpos, qvel, known[law.name])
    rigid = States(qpos.copy(), qvel.copy(), states.act[:, : model.na])
    for law, rows in zip(new, turned(track, new, rigid, driven) if new else (), strict=True):
        known[law.name] = rows[2:].T
        _shift(model, law.site, qpos, qvel, -known[law.name])
    act = np.concatenate([rigid.act, *(known[law.name] for law in after)], 1)
    return replace(rigid, qpos=qpos, qvel=qvel, act=act)


def starts_of_rotors(track: Track, states: States, gears: Sequence[Placed], driven: Driven) -> tuple[np.ndarray, ...]:
    """What is believed of rotors where a run begins, (runs, 2 g) less what `states` have, and its sd, (2 g,): that each
    carries its motor at rest, as far as it is off that elsewhere in the runs."""
    shafts = shafts_of(track, gears, states, driven)
    leads = [law.effect.law(shafts[law.site], law.site, **law.values).lead for law in gears]
    off = -states.act[:, track.model.na :]
    off[:, ::2] += np.array(leads).T.reshape(track.count, len(gears))
    return off[track.bounds[:-1]], np.sqrt(np.mean(off**2, 0))


def _shift(model, site: str, qpos: np.ndarray, qvel: np.ndarray, by: np.ndarray) -> None:
    joint = model.joint(site)
    qpos[:, joint.qposadr[0]] += by[:, 0]
    qvel[:, joint.dofadr[0]] += by[:, 1]
