"""How servos and their firmware are altered in a world."""

import numpy as np

from fimpact.benchmark.planting.ground_truth import World


def deadband(world: World, site: str, width: float) -> None:
    """A servo counts its error from the edge of a band of `width` rad around its target."""

    def make(model, data):
        motor = model.actuator(site).id
        joint, stiffness = model.actuator_trnid[motor, 0], model.actuator_gainprm[motor, 0]
        dof, place, limit = model.jnt_dofadr[joint], model.jnt_qposadr[joint], model.actuator_forcerange[motor, 1]
        drag = model.actuator_biasprm[motor, 2]

        def before_step():
            error, braking = data.ctrl[motor] - data.qpos[place], drag * data.qvel[dof]
            felt = np.sign(error) * max(abs(error) - width / 2, 0.0)
            given, asked = (min(max(stiffness * e + braking, -limit), limit) for e in (felt, error))
            data.qfrc_applied[dof] += given - asked

        return before_step

    world.hooks.append(make)


def wound_integral(world: World, site: str, rate: float, limit: float) -> None:
    """A servo that adds the integral of its error, 1/s of its gain, and holds it at `limit` N m. Outside the
    catalogue."""

    def make(model, data):
        motor = model.actuator(site).id
        joint, gain = model.actuator_trnid[motor, 0], rate * model.actuator_gainprm[motor, 0]
        dof, place, last = model.jnt_dofadr[joint], model.jnt_qposadr[joint], [0.0, 0.0]

        def before_step():
            integral, time = last
            step, error = data.time - time, data.ctrl[motor] - data.qpos[place]
            last[:] = min(max(integral + gain * error * step, -limit), limit), data.time
            data.qfrc_applied[dof] += last[0]

        return before_step

    world.hooks.append(make)
