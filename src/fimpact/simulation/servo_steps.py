"""Servos that are stiffer than a time step, or than a recording's samples, can follow.

A joint that swings on its servo, or comes to rest under it, within a step is where the servo holds it, whatever the
step does; only an explicit step does not know that. The linearly implicit Euler step takes the servo's force a step
later, (M + h D + h^2 K) dv = h (f - h K v) (Rosenbrock; Hairer and Wanner, Solving Ordinary Differential Equations II,
1996). MuJoCo's implicit integrators take it where K h is one more damping.

A swing that is faster than the samples can show (Nyquist), at a joint of which the model names no damping at all, would
go on for ever, and through every sample: no drive does that, and no log could show it. There the joint follows its
servo within the sample.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np

from fimpact.deciding import HELD
from fimpact.effects.wiring import ON_JOINT

IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


def servo_gains(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray] | None:
    """Stiffness and damping, (nv,) each, that motors give joints; None where one acts on something else."""
    stiffness, damping = np.zeros((2, model.nv))
    for motor in np.flatnonzero(model.actuator_biastype):
        if model.actuator_trntype[motor] != ON_JOINT:
            return None
        dof, gear = model.jnt_dofadr[model.actuator_trnid[motor, 0]], model.actuator_gear[motor, 0]
        stiffness[dof] -= gear**2 * model.actuator_biasprm[motor, 1]
        damping[dof] -= gear**2 * model.actuator_biasprm[motor, 2]
    return stiffness, damping


def is_long(model: mujoco.MjModel, period: float) -> bool:
    """Whether a joint under its servo and its damping comes to rest within a sample: a force is not held that long."""
    gains = servo_gains(model)
    if gains is None:
        return True
    stiffness, damping = gains
    rates = np.maximum(period * (model.dof_damping + damping), period**2 * stiffness) * model.dof_invweight0
    return bool((rates > HELD).any())


@contextmanager
def held_by_servos(models: Sequence[mujoco.MjModel], period: float) -> Iterator[None]:
    """Let `models`, sampled every `period`, s, follow those servos that are too stiff for what is to be seen of them;
    others stay as they are: their error goes with the time step, and is seen in it."""
    kept = [(own, own.opt.integrator, own.dof_damping.copy(), _added(own, period)) for own in models]
    kept = [parts for parts in kept if parts[3] is not None]
    try:
        for own, _, _, added in kept:
            own.dof_damping[:] += added
            own.opt.integrator = IMPLICIT
        yield
    finally:
        for own, integrator, damping, _ in kept:
            own.opt.integrator, own.dof_damping[:] = integrator, damping


def _added(model: mujoco.MjModel, period: float) -> np.ndarray | None:
    """Damping, (nv,), that makes steps implicit and swings decay; None where steps follow every servo."""
    gains = servo_gains(model)
    if gains is None:
        return None
    step, (stiffness, braking) = model.opt.timestep, gains
    swing = stiffness * model.dof_invweight0
    stiff, braked = step**2 * swing > HELD, step * braking * model.dof_invweight0 > HELD
    unseen = (period**2 * swing > np.pi**2) & (model.dof_damping + braking <= 0)
    if not (stiff | braked | unseen).any():
        return None
    return stiffness * np.maximum(step * stiff, period / HELD * unseen)
