"""How masses, gravity, drag and contact are altered in a world, at bodies, geoms and contact pairs."""

import mujoco
import numpy as np

from fimpact.benchmark.planting.ground_truth import World

SWUNG_OUT = 0.02  # s, damping of a base over its stiffness


def payload(world: World, site: str, mass: float, place: float) -> None:
    """A point mass, kg, stuck to body `site` at `place` m on the way from its origin to its centre of mass."""
    body = world.spec.body(site)
    _load(body, mass, place * body.ipos / np.sqrt(body.ipos @ body.ipos))


def _load(body, mass, place):
    """Parallel axes: the body and a point mass as one, its principal axes kept (all offsets are along one of them)."""
    total = body.mass + mass
    centre = (body.mass * body.ipos + mass * place) / total
    reach = body.mass * (body.ipos - centre) ** 2 + mass * (place - centre) ** 2
    body.inertia = body.inertia + reach.sum() - reach
    body.mass, body.ipos = total, centre


def com_shift(world: World, site: str, x: float, y: float, z: float = 0.0) -> None:
    """The centre of mass of body `site` lies elsewhere, m."""
    body = world.spec.body(site)
    body.ipos = body.ipos + np.array([x, y, z])


def inertia(world: World, site: str, change: float) -> None:
    """Body `site` is harder to spin than its mass says."""
    body = world.spec.body(site)
    body.inertia = body.inertia * (1 + change)


def cable_pull(world: World, site: str, stiffness: float, anchor_x: float, anchor_y: float, anchor_z: float) -> None:
    """An elastic cable, N/m, from a point of the world to the middle of body `site`, slack at no length."""
    world.spec.worldbody.add_site(name="cable_post", pos=[anchor_x, anchor_y, anchor_z])
    world.spec.body(site).add_site(name="cable_end", pos=world.spec.body(site).ipos)
    tendon = world.spec.add_tendon(name="cable", stiffness=[stiffness, 0, 0], springlength=[0, 0])
    tendon.wrap_site("cable_post")
    tendon.wrap_site("cable_end")


def gravity_tilt(world: World, site: str, tilt_x: float = 0.0, tilt_y: float = 0.0, tilt_z: float = 0.0) -> None:
    """The base leans: gravity turns about the axis and by the length, rad, of this vector (Rodrigues)."""
    gravity, turn = np.array(world.spec.option.gravity), np.array([tilt_x, tilt_y, tilt_z])
    angle = np.sqrt(turn @ turn)
    axis = turn / max(angle, 1e-300)
    across, along = np.cross(axis, gravity), (axis @ gravity) * axis
    world.spec.option.gravity = along + np.cos(angle) * (gravity - along) + np.sin(angle) * across


def base_gives_way(world: World, site: str, compliance: float) -> None:
    """The base tips by `compliance` rad/(N m) about its horizontal axes, and swings out within some hundredths of s."""
    base = world.spec.body(site)
    for name, axis in (("base_x", [1, 0, 0]), ("base_y", [0, 1, 0])):
        joint = base.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
        joint.stiffness, joint.damping = np.array([1 / compliance, 0, 0]), np.array([SWUNG_OUT / compliance, 0, 0])
        joint.armature, joint.frictionloss = 0.0, 0.0
        world.settled.append(name)


def gravity_scale(world: World, site: str, change: float) -> None:
    """Gravity is stronger than believed."""
    world.spec.option.gravity = np.array(world.spec.option.gravity) * (1 + change)


def on_body(world: World, site: str, force) -> None:
    """A force (3,), of (velocity, position, time, ctrl), at the centre of mass of body `site`."""

    def make(model, data):
        body, jacobian = model.body(site).id, np.zeros((3, model.nv))
        applied, qvel, centre = data.qfrc_applied, data.qvel, data.xipos[body]

        def before_step():
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
            applied[:] += jacobian.T @ force(jacobian @ qvel, centre, data.time)

        return before_step

    world.hooks.append(make)


def linear_drag(world: World, site: str, coefficient: float) -> None:
    """Drag in proportion to speed, N s/m."""
    on_body(world, site, lambda v, x, t: -coefficient * v)


def quadratic_drag(world: World, site: str, coefficient: float) -> None:
    """Drag in proportion to the square of speed, N s^2/m^2."""
    on_body(world, site, lambda v, x, t: -coefficient * np.sqrt(v @ v) * v)


def magnet(world: World, site: str, force: float, x: float, y: float, z: float, reach: float) -> None:
    """Attraction, N, to a point, within about `reach` m of it. Outside the catalogue."""
    point = np.array([x, y, z])

    def pull(v, place, t):
        away = point - place
        far = np.sqrt(away @ away)
        return force * away / (far + 1e-3) / (1 + (far / reach) ** 2) ** 2

    on_body(world, site, pull)


def gust(world: World, site: str, force: float, angle: float, time: float, width: float) -> None:
    """One blow of wind in every run at about `time` s, in the x-z or x-y plane. Outside the catalogue."""
    side = 2 if world.rig.plane == "xz" else 1
    direction = np.cos(angle) * np.eye(3)[0] + np.sin(angle) * np.eye(3)[side]
    on_body(world, site, lambda v, x, t: force * np.exp(-(((t - time) / width) ** 2)) * direction)


def pendulum(world: World, site: str, mass: float, rate: float) -> None:
    """A mass, kg, that swings on an unseen spring at `rate` rad/s inside body `site`. Outside the catalogue."""
    body = world.spec.body(site)
    axis = [1, 0, 0] if world.rig.plane == "xz" else [0, 1, 0]
    inner = body.add_body(name="unseen", pos=body.ipos, mass=mass, inertia=[1e-7] * 3, ipos=[0, 0, 0])
    inner.explicitinertial = True
    inner.add_joint(
        name="unseen",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=axis,
        stiffness=[mass * rate**2, 0, 0],
        damping=[0.1 * mass * rate, 0, 0],
        armature=0.0,
    )
    body.mass -= mass


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


def loose_tool(world: World, site: str, share: float, gap: float) -> None:
    """A `share` of the mass of body `site` slides to and fro by `gap` m across it, held by nothing but its ends.
    Outside the catalogue."""
    body = world.spec.body(site)
    mass = share * body.mass
    across = np.eye(3)[0 if np.argmax(np.abs(body.ipos)) else 1]
    tool = body.add_body(name="tool", pos=body.ipos, mass=mass, inertia=[1e-7] * 3, ipos=[0, 0, 0])
    tool.explicitinertial = True
    slide = tool.add_joint(name="tool", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=across)
    slide.limited, slide.range = True, [-gap / 2, gap / 2]
    slide.solref_limit, slide.armature, slide.damping = (0.005, 0.5), 0.0, np.array([mass, 0, 0])
    body.mass -= mass


def tilted_axis(world: World, site: str, tilt: float) -> None:
    """The axis of joint `site` leans by `tilt` rad from where it should point. Outside the catalogue."""
    joint = world.spec.joint(site)
    axis = np.array(joint.axis)
    across = np.eye(3)[(np.argmax(np.abs(axis)) + 1) % 3]
    joint.axis = np.cos(tilt) * axis + np.sin(tilt) * across
