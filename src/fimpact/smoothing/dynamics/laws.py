"""What laws that MuJoCo lacks do along a known motion: forces, and what sensors read.

A law with a memory is carried along each run from its start. Dry friction is taken at the expected sign of a speed that
is known to some standard deviation only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from scipy.special import erf

from fimpact.effects.base import Placed
from fimpact.effects.drives import ahead_of, is_servo, motor_force
from fimpact.effects.gears import Shaft, encoders
from fimpact.effects.law_inputs import State
from fimpact.effects.wiring import ON_JOINT
from fimpact.smoothing.dynamics.side_by_side import groups_of, longest_piece, shafts_abreast, values_of
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

DRY = ("dof_frictionloss", "dof_solref", "dof_solimp")  # fields of dry friction
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
        return _gear(track, placed, states, driven)[0].copy()
    return _forces(track, [placed], states, tau, doubt)[0]


def reading_of(
    track: Track, placed: Placed, states: States, readings: np.ndarray, surprise: np.ndarray | float = 0.0,
    driven: Driven | None = None,
) -> np.ndarray:  # fmt: skip
    """Readings, (N, ny), as `placed` changes them.

    Args:
        driven: as in `force_of`.
        surprise: (N, ny), what they hold beyond what readings before them foretold. A sensor of acceleration shows the
            missing force itself, so that its smoothed reading holds its own noise, which no law may be fitted to.
    """
    if placed.effect.enters == "gear":
        return readings + _gear(track, placed, states, driven)[1]
    if placed.effect.enters != "measurement":
        return readings
    foretold = readings - surprise
    padded = track.padded(foretold)
    signal = track.simulator.commands.signal(track.windows, padded.shape[1], track.period)
    return track.flat(placed.effect.law(padded, signal, placed.site, **placed.values)) + (readings - foretold)


def acts_of(
    track: Track, laws: Sequence[Placed], states: States, tau: np.ndarray, doubt: np.ndarray,
    driven: Driven | None = None,
) -> list[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """What each of `laws` alone adds along `states`: force, (N, nv), and change of the readings, (N, ny).

    Of gears beside what the rigid gear does; zero where it is no such law (what only readings tell: `reading_of`).

    Args:
        tau: missing force, (N, nv). doubt: sd of the speeds, (N, nv). driven: as in `force_of`.
    """
    still = (track.count, len(track.recording.channels))
    turning = [i for i, law in enumerate(laws) if law.effect.enters == "gear"]
    others = [i for i, law in enumerate(laws) if law.effect.enters != "gear"]
    forces = _forces(track, [laws[i] for i in others], states, tau, doubt)
    found = {i: (force, np.zeros(still)) for i, force in zip(others, forces, strict=True)}
    rigid: dict[tuple[str, str], Placed] = {}
    for law in (laws[i] for i in turning):
        rigid.setdefault((law.effect.name, law.site), replace(law, values=law.effect.neutral))
    acts = _gears(track, [*(laws[i] for i in turning), *rigid.values()], states, driven)
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
    seen = State(track.model, qpos, qvel, ctrl, track.time, track.period, memory, {})
    if hasattr(seen, "qacc"):
        seen.qacc = rate
    return seen


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
    out = np.zeros((len(laws) * len(rows), rows.shape[1], track.model.nv))
    memory: dict[object, object] = {}
    for k, now in enumerate(np.tile(rows, (len(laws), 1)).T[: longest_piece(track)]):
        qpos, qvel, ctrl, time = (part[now] for part in (seen.qpos, seen.qvel, seen.ctrl, seen.time))
        here = State(track.model, qpos, qvel, ctrl, time, track.period, memory, {})
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


def _gear(track: Track, placed: Placed, states: States, driven: Driven | None) -> tuple[np.ndarray, np.ndarray]:
    """Force, (N, nv), and change of the readings, (N, ny), of one gear: plants ask for both again and again."""
    driven = driven or Driven(track.model, track.ctrl[:, 0])
    around, by, found = _LATEST.get(track, (None, driven, {}))
    if around is not states or not by.same(driven):
        found = {}
        _LATEST[track] = states, driven, found
    own = placed.effect.law, placed.site
    if own not in found or found[own][0] != placed.values:
        found[own] = dict(placed.values), _gears(track, [placed], states, driven)[0]
    return found[own][1]


def _gears(
    track: Track, laws: Sequence[Placed], states: States, driven: Driven | None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Force, (N, nv), and change of the readings, (N, ny), of each of `laws`, gears that give, carried along each run.

    What drives them does not depend on what they remember: it is found for all samples at once.
    """
    driven, shafts = driven or Driven(track.model, track.ctrl[:, 0]), {}
    model, found = driven.model, {}
    seen = State(model, states.qpos, states.qvel, driven.ctrl, track.time, track.period, {}, {})
    rate = (track.next(states).qvel - states.qvel) / track.period
    for site in dict.fromkeys(law.site for law in laws):
        dof, servo = int(model.joint(site).dofadr[0]), ahead_of(seen, site) if is_servo(seen, site) else None
        rotor, speed = float(model.dof_armature[dof]), seen.joint(site)[2]
        shafts[site] = Shaft(motor_force(seen, site), speed, rotor, track.period, {}, servo)
    kinds = {i: (shafts[law.site].rotor > 0, shafts[law.site].servo is None) for i, law in enumerate(laws)}
    for group in groups_of(track, laws, kinds):
        own = [laws[i] for i in group]
        for i, (pull, inertia, *ahead) in zip(group, _turned(track, own, [shafts[w.site] for w in own]), strict=True):
            dof = int(model.joint(laws[i].site).dofadr[0])
            force, read = np.zeros_like(states.qvel), np.zeros((track.count, len(track.recording.channels)))
            force[:, dof] = pull - (inertia - model.dof_armature[dof]) * rate[:, dof]
            for mine, lead in zip(encoders(model, laws[i].site), ahead, strict=True):
                read[:, np.isin(track.simulator.columns, mine)] = lead[:, None]
            found[i] = force, read
    return [found[i] for i in range(len(laws))]


def _turned(track: Track, laws: Sequence[Placed], shafts: Sequence[Shaft]) -> list[np.ndarray]:
    """Pull, inertia, lead and its rate, (4, N), of each of `laws`, of one effect, on its own of the shafts."""
    rows, values = track.pieces[0], values_of(track, laws)
    out = np.zeros((4, len(laws) * len(rows), rows.shape[1]))
    for k, shaft in enumerate(shafts_abreast(shafts, rows[:, : longest_piece(track)])):
        now = laws[0].effect.law(shaft, laws[0].site, **values)
        out[0, :, k], out[1, :, k], out[2, :, k], out[3, :, k] = now.pull, now.inertia, now.lead, now.rate
    parts = np.split(out, len(laws), 1)
    return [np.stack([track.gathered(own) for own in part]) for part in parts]
