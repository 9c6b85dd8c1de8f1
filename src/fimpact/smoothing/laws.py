"""What laws that MuJoCo lacks do along a known motion: forces, and what sensors read.

A law with a memory is carried along each run from its start. Dry friction is taken at the expected sign of a speed that
is known to some standard deviation only.
"""

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.special import erf

from fimpact.effects.base import Placed, State
from fimpact.effects.gears import coupled, encoders
from fimpact.effects.sites import ON_JOINT
from fimpact.smoothing.states import States

DRY = ("dof_frictionloss", "dof_solref", "dof_solimp")  # fields of dry friction

if TYPE_CHECKING:
    from fimpact.smoothing.track import Track


def expected_sign(speed: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Mean sign of a speed with standard deviation `doubt`."""
    return erf(speed / np.sqrt(2) / np.maximum(doubt, 1e-12))


def slope_of_sign(speed: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Derivative of `expected_sign` by the speed."""
    doubt = np.maximum(doubt, 1e-12)
    return np.sqrt(2 / np.pi) / doubt * np.exp(-((speed / doubt) ** 2) / 2)


def friction_slope(track: "Track", placed: Placed, states: States, tau: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Derivative, (N, nv), of the dry friction that `placed` adds, by the speed half a sample later."""
    out = np.zeros_like(states.qvel)
    if placed.effect.enters != "friction":
        return out
    seen = _state(track, states, predicted_commands(track, track.ctrl, tau)[:, 0], {})
    forward, backward = placed.effect.law(seen, placed.site, **placed.values)
    dof = int(track.model.joint(placed.site).dofadr[0])
    out[:, dof] = (
        -(forward + backward) / 2 * slope_of_sign(seen.qvel[:, dof], speed_doubt(track, states, doubt)[:, dof])
    )
    return out


def force_of(track: "Track", placed: Placed, states: States, tau: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Generalised force, (N, nv), that `placed` adds along `states`; zero where it is no such law.

    Args:
        tau: missing force, (N, nv). doubt: sd of the speeds, (N, nv).
    """
    enters = placed.effect.enters
    if enters == "friction":
        return _friction(track, placed, states, tau, doubt)
    if enters == "force":
        return _law(track, placed, states, tau)
    if enters == "gear":
        return _gear(track, placed, states, tau)[0]
    return np.zeros_like(states.qvel)


def reading_of(track: "Track", placed: Placed, states: States, tau: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """Readings, (N, ny), as `placed` changes them."""
    if placed.effect.enters == "gear":
        return readings + _gear(track, placed, states, tau)[1]
    if placed.effect.enters != "measurement":
        return readings
    padded = track.padded(readings)
    signal = track.simulator.commands.signal(track.windows, padded.shape[1], track.period)
    return track.flat(placed.effect.law(padded, signal, placed.site, **placed.values))


def middle(track: "Track", states: States) -> tuple[np.ndarray, np.ndarray]:
    """qpos (N, nq) and qvel (N, nv) half a sample later: a force is held over the sample."""
    after = track.next(states)
    return states.qpos + (after.qpos - states.qpos) / 2, (states.qvel + after.qvel) / 2


def predicted_commands(track: "Track", ctrl: np.ndarray, tau: np.ndarray) -> np.ndarray:
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


def _state(track: "Track", states: States, ctrl: np.ndarray, memory: dict) -> State:
    qpos, qvel = middle(track, states)
    after = track.next(states)
    rate = (after.qvel - states.qvel) / track.period
    seen = State(track.model, qpos, qvel, ctrl, track.time, track.period, memory, {})
    if hasattr(seen, "qacc"):
        seen.qacc = rate
    return seen


def _law(track: "Track", placed: Placed, states: States, tau: np.ndarray) -> np.ndarray:
    ctrl = predicted_commands(track, track.ctrl, tau)[:, 0]
    seen = _state(track, states, ctrl, {})
    force = placed.effect.law(seen, placed.site, **placed.values)
    if not seen.remembers:
        return force
    rows, memory = track.pieces[0], {}
    out = np.zeros((*rows.shape, track.model.nv))
    whole = _state(track, states, ctrl, {})
    for k, now in enumerate(rows.T):
        parts = whole.qpos[now], whole.qvel[now], whole.ctrl[now], whole.time[now]
        state = State(track.model, *parts, track.period, memory, {})
        out[:, k] = placed.effect.law(state, placed.site, **placed.values)
    return track.gathered(out)


def _friction(track: "Track", placed: Placed, states: States, tau: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    seen = _state(track, states, predicted_commands(track, track.ctrl, tau)[:, 0], {})
    forward, backward = placed.effect.law(seen, placed.site, **placed.values)
    dof = int(track.model.joint(placed.site).dofadr[0])
    sign = expected_sign(seen.qvel[:, dof], speed_doubt(track, states, doubt)[:, dof])
    out = np.zeros_like(states.qvel)
    out[:, dof] = -(forward * (1 + sign) - backward * (1 - sign)) / 2
    return out


def speed_doubt(track: "Track", states: States, doubt: np.ndarray) -> np.ndarray:
    """sd of the speeds over a sample, (N, nv): what is not known of them, and what they change within it."""
    change = track.next(states).qvel - states.qvel
    return np.sqrt(doubt**2 + change**2 / 12)


def _gear(track: "Track", placed: Placed, states: States, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force, (N, nv), and change of the readings, (N, ny), of a gear that gives, carried along each run."""
    model = track.model
    dof = int(model.joint(placed.site).dofadr[0])
    columns = [np.isin(track.simulator.columns, own) for own in encoders(model, placed.site)]
    rows, memory = track.pieces[0], {}
    rate = (track.next(states).qvel - states.qvel)[:, dof] / track.period
    force, lead, speed = (np.zeros((len(rows), rows.shape[1])) for _ in range(3))
    for k, now in enumerate(rows.T):
        state = State(
            model, states.qpos[now], states.qvel[now], track.ctrl[now, 0], track.time[now], track.period, memory
        )
        found = coupled(model, state, placed.effect.law, placed.site, placed.values)
        force[:, k] = found.pull - (found.inertia - model.dof_armature[dof]) * rate[now]
        lead[:, k], speed[:, k] = found.lead, found.rate
    out, read = np.zeros_like(states.qvel), np.zeros((track.count, len(track.recording.channels)))
    out[:, dof] = track.gathered(force)
    for own, ahead in zip(columns, (lead, speed), strict=True):
        read[:, own] = track.gathered(ahead)[:, None]
    return out, read


def touching(track: "Track", states: States) -> np.ndarray:
    """Whether anything touches, (N,), at the start of each sample or at its end."""
    data, model = mujoco.MjData(track.model), track.model
    now = np.zeros(track.count, bool)
    for k, qpos in enumerate(states.qpos):
        data.qpos[:] = qpos
        mujoco.mj_fwdPosition(model, data)
        now[k] = data.ncon > 0
    return now
