"""How contact pairs and the ground are altered in a world."""

import mujoco
import numpy as np

from fimpact.benchmark.planting.ground_truth import World


def _pairs(world, site):
    """The contact pair `site`, or every pair of the geom `site`."""
    return [p for p in world.spec.pairs if site in (p.name, p.geomname1, p.geomname2)]


def ground_height(world: World, site: str, height: float) -> None:
    """The ground lies `height` m further out along its own normal."""
    geom = world.spec.geom(site)
    geom.pos = geom.pos + height * _normal(world, site)


def _normal(world, site):
    return _turned(world.rig.naive.geom(site).quat)


def _turned(quat):
    out = np.zeros(3)
    mujoco.mju_rotVecQuat(out, np.array([0.0, 0.0, 1.0]), quat)
    return out


def ground_tilt(world: World, site: str, tilt_y: float) -> None:
    """The ground leans by `tilt_y` rad in the plane of motion, which its own y axis is normal to."""
    geom, turn, out = world.spec.geom(site), np.zeros(4), np.zeros(4)
    axis = np.array([0.0, 1.0, 0.0] if world.rig.plane == "xz" else [0.0, 0.0, 1.0])
    mujoco.mju_axisAngle2Quat(turn, axis, tilt_y)
    mujoco.mju_mulQuat(out, turn, world.rig.naive.geom(site).quat)
    geom.quat, geom.alt.type = out, mujoco.mjtOrientation.mjORIENTATION_QUAT


def sliding_friction(world: World, site: str, change: float) -> None:
    """Coefficient of sliding friction, off by `change`."""
    for pair in _pairs(world, site):
        pair.friction = np.array([*(pair.friction[:2] + change), *pair.friction[2:]])


def contact_stiffness(world: World, site: str, change: float) -> None:
    """Contact stiffer by the factor 1 + `change`, its damping kept: solref stiffness is 1/(timeconst dampratio)^2."""
    for pair in _pairs(world, site):
        pair.solref = np.array([pair.solref[0], pair.solref[1] / np.sqrt(1 + change)])


def contact_damping(world: World, site: str, change: float) -> None:
    """Contact more damped by the factor 1 + `change`, its stiffness kept: solref damping goes with 1/timeconst."""
    for pair in _pairs(world, site):
        pair.solref = np.array([pair.solref[0] / (1 + change), pair.solref[1] * (1 + change)])


def rolling_friction(world: World, site: str, coefficient: float) -> None:
    """Friction against rolling, m."""
    for pair in _pairs(world, site):
        pair.condim = 6
        pair.friction = np.array([*pair.friction[:3], coefficient, coefficient])


def rounded_edge(world: World, site: str, radius: float) -> None:
    """What touches is round by `radius` m more than believed; the faces stay where they are."""
    for pair in _pairs(world, site):
        geom = world.spec.geom(pair.geomname2)
        geom.pos = geom.pos - radius * np.sign(geom.pos) * (np.abs(geom.pos) > 1e-9)
        geom.size = geom.size + np.array([radius, 0, 0])


def sticky(world: World, site: str, force: float, reach: float) -> None:
    """Glue: the ground pulls every corner within `reach` m of it, N. Outside the catalogue."""

    def make(model, data):
        corners = [model.geom(p.geomname2).id for p in _pairs(world, site)]
        plane, normal = model.geom(site).id, _normal(world, site)
        jacobian = np.zeros((3, model.nv))

        def before_step():
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            for corner in corners:
                gap = (data.geom_xpos[corner] - data.geom_xpos[plane]) @ normal - model.geom_size[corner, 0]
                if 0 < gap < reach:
                    mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[corner], model.geom_bodyid[corner])
                    data.qfrc_applied -= jacobian.T @ (force * (1 - gap / reach) * normal)

        return before_step

    world.hooks.append(make)


def wavy_ground(world: World, site: str, height: float, length: float) -> None:
    """Ground that rises and falls by `height` m every `length` m along x. Outside the catalogue."""

    def make(model, data):
        # Where it lies, and not where the run before left it.
        plane, normal, home = model.geom(site).id, _normal(world, site), world.rig.naive.geom(site).pos
        corners = [model.geom(p.geomname2).id for p in _pairs(world, site)]
        model.geom_sameframe[plane] = 0  # else a geom that sat in its body's origin would stay there

        def before_step():
            mujoco.mj_kinematics(model, data)
            lowest = min(corners, key=lambda c: data.geom_xpos[c] @ normal)
            x = data.geom_xpos[lowest][0]
            model.geom_pos[plane] = home + height * np.sin(2 * np.pi * x / length) * normal

        return before_step

    world.hooks.append(make)
