"""What gears that give do along a known motion: forces on the links, and what encoders read of the motors.

Each is carried along each run from its start; what drives it does not depend on what it remembers, and is found for all
samples at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.drives import ahead_of, is_servo, motor_force
from fimpact.effects.gears import Shaft, encoders
from fimpact.effects.law_inputs import State
from fimpact.smoothing.dynamics.side_by_side import groups_of, longest_piece, shafts_abreast, values_of
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

DRIVES = ("dof_armature", "actuator_gainprm", "actuator_biasprm", "actuator_forcerange")  # what effects change of them
_LATEST: WeakKeyDictionary = WeakKeyDictionary()  # of each track: states, and what gears did along them


@dataclass(frozen=True)
class Driven:
    """What drives the gears of a hypothesis: its model, with rotors and motors, and commands that reach it, (N, nu)."""

    model: mujoco.MjModel
    ctrl: np.ndarray

    def same(self, other: "Driven") -> bool:
        """Whether it drives them alike."""
        fields = all(np.array_equal(getattr(self.model, name), getattr(other.model, name)) for name in DRIVES)
        return fields and np.array_equal(self.ctrl, other.ctrl)


def gear_of(track: Track, placed: Placed, states: States, driven: Driven | None) -> tuple[np.ndarray, np.ndarray]:
    """Force, (N, nv), and change of the readings, (N, ny), of one gear: plants ask for both again and again."""
    driven = driven or Driven(track.model, track.ctrl[:, 0])
    around, by, found = _LATEST.get(track, (None, driven, {}))
    if around is not states or not by.same(driven):
        found = {}
        _LATEST[track] = states, driven, found
    own = placed.effect.law, placed.site
    if own not in found or found[own][0] != placed.values:
        found[own] = dict(placed.values), gears_along(track, [placed], states, driven)[0]
    return found[own][1]


def gears_along(
    track: Track, laws: Sequence[Placed], states: States, driven: Driven | None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Force, (N, nv), and change of the readings, (N, ny), of each of `laws`, gears that give."""
    driven = driven or Driven(track.model, track.ctrl[:, 0])
    model, out = driven.model, []
    rate = (track.next(states).qvel - states.qvel) / track.period
    for law, (pull, inertia, *ahead) in zip(laws, turned(track, laws, states, driven), strict=True):
        dof = int(model.joint(law.site).dofadr[0])
        force, read = np.zeros_like(states.qvel), np.zeros((track.count, len(track.recording.channels)))
        force[:, dof] = pull - (inertia - model.dof_armature[dof]) * rate[:, dof]
        for mine, lead in zip(encoders(model, law.site), ahead, strict=True):
            read[:, np.isin(track.simulator.columns, mine)] = lead[:, None]
        out.append((force, read))
    return out


def turned(track: Track, laws: Sequence[Placed], states: States, driven: Driven | None = None) -> list[np.ndarray]:
    """Pull, inertia, lead and its rate, (4, N), of each of `laws`, gears that give, carried along each run."""
    shafts, found = shafts_of(track, laws, states, driven), {}
    kinds = {i: (shafts[law.site].rotor > 0, shafts[law.site].servo is None) for i, law in enumerate(laws)}
    for group in groups_of(track, laws, kinds):
        own = [laws[i] for i in group]
        for i, rows in zip(group, _turned(track, own, [shafts[w.site] for w in own]), strict=True):
            found[i] = rows
    return [found[i] for i in range(len(laws))]


def shafts_of(track: Track, laws: Sequence[Placed], states: States, driven: Driven | None = None) -> dict[str, Shaft]:
    """Shaft of the joint of each of `laws` in all samples."""
    driven, found = driven or Driven(track.model, track.ctrl[:, 0]), {}
    model = driven.model
    seen = State(model, states.qpos, states.qvel, driven.ctrl, track.time, track.period, {}, {})
    for site in dict.fromkeys(law.site for law in laws):
        dof, servo = int(model.joint(site).dofadr[0]), ahead_of(seen, site) if is_servo(seen, site) else None
        rotor, speed = float(model.dof_armature[dof]), seen.joint(site)[2]
        found[site] = Shaft(motor_force(seen, site), speed, rotor, track.period, {}, servo)
    return found


def _turned(track: Track, laws: Sequence[Placed], shafts: Sequence[Shaft]) -> list[np.ndarray]:
    """Pull, inertia, lead and its rate, (4, N), of each of `laws`, of one effect, on its own of the shafts."""
    rows, values = track.pieces[0], values_of(track, laws)
    out = np.zeros((4, len(laws) * len(rows), rows.shape[1]))
    for k, shaft in enumerate(shafts_abreast(shafts, rows[:, : longest_piece(track)])):
        now = laws[0].effect.law(shaft, laws[0].site, **values)
        out[0, :, k], out[1, :, k], out[2, :, k], out[3, :, k] = now.pull, now.inertia, now.lead, now.rate
    parts = np.split(out, len(laws), 1)
    return [np.stack([track.gathered(own) for own in part]) for part in parts]
