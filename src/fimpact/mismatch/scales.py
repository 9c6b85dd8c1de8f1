"""Typical magnitudes of a recording, so that an effect can be tried at a size that means something there."""

import mujoco
import numpy as np

from fimpact.effects.base import Scales
from fimpact.mismatch.problem import Point, Problem
from fimpact.mismatch.simulate import Simulator
from fimpact.mismatch.windows import Windows

SAMPLES = 400  # states whose inverse dynamics is averaged
OFTEN = 0.95  # share of the time in which a servo gives no more than its largest force
EARTH = 9.81  # m/s^2


def scales(problem: Problem, point: Point) -> Scales:
    """Scales of the motion that the model at `point` predicts for the problem's windows."""
    simulator, windows = problem.simulator, problem.windows
    qpos, qvel = simulator.motion(point.hypothesis, windows, point.qpos, point.qvel)
    model = simulator.model(point.hypothesis)
    drive, summit = _drives(simulator, windows, model, qpos, qvel)
    travel = (qpos - qpos.mean((0, 1))).reshape(-1, model.nq)
    moving = model.body_mass[model.body_weldid > 0]
    gravity = float(np.linalg.norm(model.opt.gravity))
    return Scales(
        force=_force(model, qpos, qvel),
        speed=_rms(qvel.reshape(-1, model.nv)),
        travel=_rms(travel)[_position_of_dof(model)],
        middle=qpos.mean((0, 1))[_position_of_dof(model)],
        drive=drive,
        summit=summit,
        measured=np.array([_spread(column) for column in windows.measured.reshape(-1, windows.measured.shape[2]).T]),
        mass=float(moving.sum()),
        length=float(model.stat.extent),
        gravity=gravity or EARTH,
        period=simulator.recording.period,
        duration=windows.ctrl.shape[1] * simulator.recording.period,
    )


def _spread(column: np.ndarray) -> float:
    """Standard deviation of what was measured; 0 where nothing was."""
    known = column[np.isfinite(column)]
    return float(known.std()) if known.size else 0.0


def _rms(rows: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(np.mean(rows**2, 0), np.finfo(float).tiny))


def _position_of_dof(model: mujoco.MjModel) -> np.ndarray:
    # A rotation's scale is that of its quaternion's vector part.
    place = np.empty(model.nv, int)
    for joint in range(model.njnt):
        width = {mujoco.mjtJoint.mjJNT_FREE: 6, mujoco.mjtJoint.mjJNT_BALL: 3}.get(
            mujoco.mjtJoint(model.jnt_type[joint]), 1
        )
        extra = np.arange(width) + (np.arange(width) >= 3 if width == 6 else width == 3)
        first = model.jnt_dofadr[joint]
        place[first : first + width] = model.jnt_qposadr[joint] + extra
    return place


def _drives(simulator: Simulator, windows: Windows, model: mujoco.MjModel, qpos, qvel) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square and largest force of each actuator, before its gear, (nu,) each: of a motor from its commands,
    of a servo from where the model is at the moment as well."""
    ctrl = windows.ctrl.reshape(np.prod(windows.ctrl.shape[:2]), model.nu)
    gain = np.abs(model.actuator_gainprm[:, 0])
    drive, summit = gain * _rms(ctrl), gain * np.abs(ctrl).max(0, initial=0.0)
    servos = model.actuator_biastype != mujoco.mjtBias.mjBIAS_NONE
    if servos.any():
        told = simulator.commands.signal(windows, qpos.shape[1]).ctrl
        given = np.array([_given(model, qpos[w, k], qvel[w, k], told[w, k + 1]) for w, k in _some(qpos)])
        # Where the model is far from its target, as at the start of windows that it does not fit, it snaps.
        largest = np.quantile(np.abs(given), OFTEN, 0)
        drive[servos], summit[servos] = np.minimum(_rms(given), largest)[servos], largest[servos]
    return drive, summit


def _given(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(model, data)
    return data.actuator_force.copy()


def _some(qpos: np.ndarray) -> list[tuple[int, int]]:
    """Windows and steps of some states (w, n, nq) that have one after them."""
    rows, each = qpos.shape[0] * (qpos.shape[1] - 1), qpos.shape[1] - 1
    return [divmod(int(flat), each) for flat in np.linspace(0, rows - 1, min(SAMPLES, rows))]


def _force(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Root mean square force that accelerates and carries each degree of freedom, (nv,)."""
    data, found, step = mujoco.MjData(model), [], model.opt.timestep
    for w, k in _some(qpos):
        data.qpos[:], data.qvel[:] = qpos[w, k], qvel[w, k]
        data.qacc[:] = (qvel[w, k + 1] - qvel[w, k]) / step
        mujoco.mj_inverse(model, data)
        found.append(np.abs(data.qfrc_inverse) + np.abs(data.qfrc_bias))
    return _rms(np.array(found))
