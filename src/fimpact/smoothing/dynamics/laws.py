"""What laws that MuJoCo lacks do along a known motion: forces, and what sensors read.

A law with a memory is carried along each run from its start. Dry friction is taken at the expected sign of a speed that
is known to some standard deviation only.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np
from scipy.special import erf

from fimpact.effects.base import Placed
from fimpact.effects.law_inputs import State
from fimpact.effects.wiring import ON_JOINT
from fimpact.smoothing.dynamics.gear_laws import Driven, gear_of, gears_along
from fimpact.smoothing.dynamics.side_by_side import groups_of, longest_piece, values_of
from fimpact.smoothing.dynamics.track import Step, Track
from fimpact.smoothing.states import States

DRY = ("dof_frictionloss", "dof_solref", "dof_solimp")  # fields of dry friction


def expected_sign(speed: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Mean sign of a speed with standard deviation `doubt`."""
    return erf(speed / np.sqrt(2) / np.maximum(doubt, 1e-12))


def slope_of_sign(speed: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Derivative of `expected_sign` by the speed."""
    doubt = np.maximum(doubt, 1e-12)
    return np.sqrt(2 / np.pi) / doubt * np.exp(-((speed / doubt) ** 2) / 2)


def bounds_of(track: Track, placed: Placed, states: States, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Dry friction of a law, (N,), while its joint moves forward and backward."""
    seen = _state(track, states, predicted_commands(track, track.ctrl, tau)[:, 0], {})
    forward, backward = placed.effect.law(seen, placed.site, **placed.values)
    return np.broadcast_to(forward, track.count), np.broadcast_to(backward, track.count)


def force_of(
    track: Track, placed: Placed, states: States, tau: np.ndarray, doubt: np.ndarray, driven: Driven | None = None
) -> np.ndarray:
    """Generalised force, (N, nv), that `placed` adds along `states`; zero where it is no such law.

    Args:
        tau: missing force, (N, nv). doubt: sd of the speeds, (N, nv). driven: what drives gears, default: what the
            track has.
    """
    if placed.effect.enters == "gear":
        return gear_of(track, placed, states, driven)[0].copy()
    return _forces(track, [placed], states, tau, doubt)[0]


def read_by(
    track: Track, placed: Placed, states: States, found: Step, surprise: np.ndarray | float = 0.0,
    driven: Driven | None = None,
) -> Step:  # fmt: skip
    """`found`, as `placed` changes its readings.

    Args:
        driven: as in `force_of`.
        surprise: (N, ny), what they hold beyond what readings before them foretold. A sensor of acceleration shows the
            missing force itself, so that its smoothed reading holds its own noise, which no law may be fitted to.
    """
    within = found.readings[:, None] if found.within is None else found.within
    if placed.effect.enters == "gear":
        within = within + gear_of(track, placed, states, driven)[1][:, None]
    elif placed.effect.enters == "measurement":
        parts, beyond = within.shape[1], np.zeros_like(found.readings) + surprise
        padded = track.padded(within - beyond[:, None])
        rows = padded.reshape(len(padded), -1, padded.shape[3])
        signal = track.simulator.commands.signal(track.windows, rows.shape[1], track.period / parts)
        if track.model.nu:  # forces jump when commands do
            signal = replace(signal, parts=parts)
        read = placed.effect.law(rows, signal, placed.site, **placed.values)
        within = track.flat(read.reshape(padded.shape)) + beyond[:, None]
    else:
        return found
    return replace(found, readings=within[:, 0], within=None if found.within is None else within)


def acts_of(
    track: Track, laws: Sequence[Placed], states: States, tau: np.ndarray, doubt: np.ndarray,
    driven: Driven | None = None,
) -> list[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """What each of `laws` alone adds along `states`: force, (N, nv), and change of the readings, (N, ny).

    Of gears beside what the rigid gear does; zero where it is no such law (what only readings tell: `read_by`).

    Args:
        tau: missing force, (N, nv). doubt: sd of the speeds, (N, nv). driven: what drives gears, default:
            what the track has.
    """
    still = (track.count, len(track.recording.channels))
    turning = [i for i, law in enumerate(laws) if law.effect.enters == "gear"]
    others = [i for i, law in enumerate(laws) if law.effect.enters != "gear"]
    forces = _forces(track, [laws[i] for i in others], states, tau, doubt)
    found = {i: (force, np.zeros(still)) for i, force in zip(others, forces, strict=True)}
    rigid: dict[tuple[str, str], Placed] = {}
    for law in (laws[i] for i in turning):
        rigid.setdefault((law.effect.name, law.site), replace(law, values=law.effect.neutral))
    acts = gears_along(track, [*(laws[i] for i in turning), *rigid.values()], states, driven)
    beside = dict(zip(rigid, acts[len(turning) :], strict=True))
    for i, act in zip(turning, acts[: len(turning)], strict=True):
        none = beside[laws[i].effect.name, laws[i].site]
        found[i] = act[0] - none[0], act[1] - none[1]
    return [found[i] for i in range(len(laws))]


def middle(track: Track, states: States) -> tuple[np.ndarray, np.ndarray]:
    """qpos (N, nq) and qvel (N, nv) half a sample later: a force is held over the sample."""
    after = track.next(states)
    return states.qpos + (after.qpos - states.qpos) / 2, (states.qvel + after.qvel) / 2


def predicted_commands(track: Track, ctrl: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Commands, (N, 1 or substeps, nu), under which motors on joints give what the model needs for the motion.

    The applied torque is an output: what depends on the load must not be told what friction already took of it.
    """
    model, told = track.model, np.array(ctrl, float)
    for motor in range(model.nu):
        per_unit = model.actuator_gainprm[motor, 0] * model.actuator_gear[motor, 0]
        plain = model.actuator_biastype[motor] == mujoco.mjtBias.mjBIAS_NONE
        if plain and per_unit and model.actuator_trntype[motor] == ON_JOINT:
            dof = model.jnt_dofadr[model.actuator_trnid[motor, 0]]
            told[:, :, motor] += tau[:, None, dof] / per_unit
    return told


def _state(track: Track, states: States, ctrl: np.ndarray, memory: dict) -> State:
    qpos, qvel = middle(track, states)
    after = track.next(states)
    rate = (after.qvel - states.qvel) / track.period
    return State(track.model, qpos, qvel, ctrl, track.time, track.period, memory, {}, rate)


def _forces(track: Track, laws: Sequence[Placed], states: States, tau: np.ndarray, doubt) -> list[np.ndarray]:
    """Force, (N, nv), of each law that is no gear."""
    found = [np.zeros_like(states.qvel) for _ in laws]
    if not any(law.effect.enters in ("force", "friction") for law in laws):
        return found
    remembering, ctrl = [], predicted_commands(track, track.ctrl, tau)[:, 0]
    seen = _state(track, states, ctrl, {})  # by all of them: where bodies are takes longer than most laws
    for i, law in enumerate(laws):
        own = replace(seen, memory={})
        if law.effect.enters == "friction":
            found[i] = _friction(track, law, own, states, doubt)
        elif law.effect.enters == "force":
            found[i] = law.effect.law(own, law.site, **law.values)
            remembering += [i] if own.remembers else []
    for group in groups_of(track, laws, {i: laws[i].site for i in remembering}):
        for i, force in zip(group, _carried(track, [laws[i] for i in group], seen), strict=True):
            found[i] = force
    return found


def _carried(track: Track, laws: Sequence[Placed], seen: State) -> list[np.ndarray]:
    """Force, (N, nv), of each of `laws`, one effect at one site, as they remember each run from its start."""
    (law, *_), rows, values = laws, track.pieces[0], values_of(track, laws)
    assert seen.qacc is not None
    out = np.zeros((len(laws) * len(rows), rows.shape[1], track.model.nv))
    memory: dict[object, object] = {}
    for k, now in enumerate(np.tile(rows, (len(laws), 1)).T[: longest_piece(track)]):
        qpos, qvel, ctrl, time, qacc = (part[now] for part in (seen.qpos, seen.qvel, seen.ctrl, seen.time, seen.qacc))
        here = State(track.model, qpos, qvel, ctrl, time, track.period, memory, {}, qacc)
        out[:, k] = law.effect.law(here, law.site, **values)
    return [track.gathered(own) for own in np.split(out, len(laws))]


def _friction(track: Track, placed: Placed, seen: State, states: States, doubt: np.ndarray) -> np.ndarray:
    forward, backward = placed.effect.law(seen, placed.site, **placed.values)
    dof = int(track.model.joint(placed.site).dofadr[0])
    sign = expected_sign(seen.qvel[:, dof], speed_doubt(track, states, doubt)[:, dof])
    out = np.zeros_like(states.qvel)
    out[:, dof] = -(forward * (1 + sign) - backward * (1 - sign)) / 2
    return out


def speed_doubt(track: Track, states: States, doubt: np.ndarray) -> np.ndarray:
    """sd of the speeds over a sample, (N, nv): what is not known of them, and what they change within it."""
    change = track.next(states).qvel - states.qvel
    return np.sqrt(doubt**2 + change**2 / 12)
