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
