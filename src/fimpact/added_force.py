"""What the improved model pushes with beyond the naive fit, in the states that were recorded."""

import mujoco
import numpy as np

from fimpact.effects.base import State
from fimpact.mismatch.diagnose import Diagnosis


def added_force(diagnosis: Diagnosis, dof: int) -> np.ndarray | None:
    """Force, (w * BINS,), that the improved model has beyond the naive fit in the states of the residual force.

    Measured as the difference of their accelerations times the naive inertia, so that it holds for fields and laws
    alike. None where nothing was added that acts on the motion.
    """
    naming, simulator = diagnosis.naming, diagnosis.bench.training.simulator
    acting = [p for p in naming.best.placed if p.effect.enters not in ("measurement", "gear")]
    if not acting:
        return None
    location, windows = diagnosis.location, diagnosis.bench.training.windows
    qpos, qvel = (part.reshape(-1, part.shape[-1]) for part in (location.qpos, location.qvel))
    row = (location.time / diagnosis.recording.period + 1e-9).astype(int)
    ctrl = windows.ctrl[windows.runs[:, None], np.minimum(row, windows.ctrl.shape[1] - 1)].reshape(len(qpos), -1)
    naive = simulator.model(naming.naive.fitted.point.hypothesis)
    best = simulator.model(naming.best.fitted.point.hypothesis)
    pull = law_force(best, acting, qpos, qvel, ctrl, location.time.ravel())
    return _force_between(naive, best, qpos, qvel, ctrl, pull)[:, dof]


def law_force(model, placed, qpos, qvel, ctrl, time) -> np.ndarray:
    """Generalised force of the force laws, (n, nv); those with a memory are shown as at the start of a window."""
    seen = State(model, qpos, qvel, ctrl, time, model.opt.timestep, {})
    out = sum((p.effect.law(seen, p.site, **p.values) for p in placed if p.effect.enters == "force"), 0 * qvel)
    for p in (p for p in placed if p.effect.enters == "friction"):
        dof, _, speed = seen.joint(p.site)
        forward, backward = p.effect.law(seen, p.site, **p.values)
        out[:, dof] += np.where(speed > 0, -forward, backward)
    return out


def _force_between(naive, best, qpos, qvel, ctrl, pull) -> np.ndarray:
    found, inertia = np.empty_like(qvel), np.empty((naive.nv, naive.nv))
    left, right = mujoco.MjData(naive), mujoco.MjData(best)
    for i in range(len(qpos)):
        for data, model in ((left, naive), (right, best)):
            data.qpos[:], data.qvel[:], data.ctrl[:] = qpos[i], qvel[i], ctrl[i]
            data.qfrc_applied[:] = pull[i] if model is best else 0.0
            mujoco.mj_forward(model, data)
        mujoco.mj_fullM(naive, left, inertia)
        found[i] = inertia @ (right.qacc - left.qacc)
    return found
