"""How friction, transmission and springs are put into a world, at one joint."""

import mujoco
import numpy as np

from fimpact.benchmark.planting.ground_truth import World, sharp_dry_friction

NEARLY_NONE = 1e-9  # N m: a friction row must exist when the model is compiled


def coulomb(world: World, site: str, friction: float) -> None:
    """Dry friction, N m: against the speed, whatever it is, and at rest as much as it takes."""
    _exact(world, site).frictionloss += friction


def _exact(world, site):
    """The joint, its dry friction as sharp as the step."""
    joint = world.spec.joint(site)
    sharp_dry_friction(joint, world.step)
    return joint


def viscous(world: World, site: str, damping: float) -> None:
    """More damping than believed, N m s/rad."""
    joint = world.spec.joint(site)
    joint.damping = joint.damping + np.array([damping, 0, 0])


def quadratic_damping(world: World, site: str, damping: float) -> None:
    """Torque against the square of speed, N m s^2/rad^2."""
    joint = world.spec.joint(site)
    joint.damping = joint.damping + np.array([0, damping, 0])


def _dry(world, site, level):
    """Native dry friction whose level, beside what is known, of (speed, position, actuator torque, time),
    follows the motion.

    The speed that `level` gets has the sign of the way on which friction is met: where the joint rests, that on which
    it would break away.
    """
    rubbing = _exact(world, site)
    known, rubbing.frictionloss = rubbing.frictionloss, rubbing.frictionloss + NEARLY_NONE

    def make(model, data):
        joint = model.joint(site)
        dof, place = joint.dofadr[0], joint.qposadr[0]
        motor = _motor(model, site)

        def before_step():
            speed, drive = _opposed(data, dof), _driven(model, data, motor)
            more = level(speed, data.qpos[place], drive, data.time)
            model.dof_frictionloss[dof] = known + max(more, NEARLY_NONE)

        return before_step

    world.hooks.append(make)


def _opposed(data, dof):
    """Speed of `dof` with the sign that dry friction, as it was in the last step, opposes."""
    rows = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF) & (data.efc_id == dof)
    friction = data.efc_force[rows].sum()
    return -np.copysign(data.qvel[dof], friction) if friction else data.qvel[dof]


def _driven(model, data, motor):
    """Torque of a motor, 0 where there is none: of a servo that of the step before."""
    if motor < 0:
        return 0.0
    serves = model.actuator_biasprm[motor, 1] != 0
    return data.actuator_force[motor] if serves else data.ctrl[motor] * model.actuator_gainprm[motor, 0]


def _motor(model, site):
    joint = model.joint(site).id
    return next((i for i in range(model.nu) if model.actuator_trnid[i, 0] == joint), -1)


def asymmetric_coulomb(world: World, site: str, forward: float, backward: float) -> None:
    """Dry friction of `forward` N m at positive and `backward` N m at negative speed."""
    _dry(world, site, lambda v, q, u, t: forward if v > 0 else backward)


def stribeck(world: World, site: str, coulomb: float, excess: float, speed: float) -> None:
    """Dry friction of `coulomb` N m and `excess` more near rest, gone above `speed` rad/s."""
    _dry(world, site, lambda v, q, u, t: coulomb + excess * np.exp(-((v / speed) ** 2)))


def load_friction(world: World, site: str, coefficient: float) -> None:
    """Dry friction in proportion to the motor's torque."""
    _dry(world, site, lambda v, q, u, t: coefficient * abs(u))


def rough_spot(world: World, site: str, torque: float, centre: float, width: float) -> None:
    """Dry friction in one place only, rad. Outside the catalogue."""
    _dry(world, site, lambda v, q, u, t: torque * np.exp(-(((q - centre) / width) ** 2)))


def warming(world: World, site: str, torque: float, time: float) -> None:
    """Dry friction that dies away within the run as the grease warms, s. Outside the catalogue."""
    _dry(world, site, lambda v, q, u, t: torque * np.exp(-t / time))


def self_heating(world: World, site: str, damping: float, heat: float) -> None:
    """Viscous friction of cold grease, N m s/rad, of which `heat` J of its own loss leave 1/e. Outside the
    catalogue."""

    def law(v, q, u, t, h, memory):
        level = damping * np.exp(-memory.get("lost", 0.0) / heat)
        memory["lost"] = memory.get("lost", 0.0) + level * v * v * h
        return -level * v

    push(world, site, law)


def push(world: World, site: str, torque) -> None:
    """A generalised force, of (speed, position, motor torque, time, step, memory), at a joint."""

    def make(model, data):
        joint, memory = model.joint(site), {}
        dof, place, motor = joint.dofadr[0], joint.qposadr[0], _motor(model, site)

        def before_step():
            drive, step = _driven(model, data, motor), model.opt.timestep
            data.qfrc_applied[dof] += torque(data.qvel[dof], data.qpos[place], drive, data.time, step, memory)

        return before_step

    world.hooks.append(make)


def dahl(world: World, site: str, friction: float, displacement: float) -> None:
    """Pre-sliding friction: a bristle that bends over `displacement` rad and yields at `friction` N m."""

    def law(v, q, u, t, h, memory):
        sign, last = np.sign(v), memory.get("bristle", 0.0)
        memory["bristle"] = sign + (last - sign) * np.exp(-abs(v) * h / displacement)
        return -0.5 * friction * (last + memory["bristle"])

    push(world, site, law)


def torque_ripple(world: World, site: str, sine: float, cosine: float, cycles: float) -> None:
    """Cogging: N m, `cycles` per turn."""
    push(world, site, lambda v, q, u, t, h, memory: sine * np.sin(cycles * q) + cosine * np.cos(cycles * q))


def efficiency(world: World, site: str, driving: float, driven: float) -> None:
    """The gear loses a share `driving` of the motor's torque, and costs a share `driven` of it when driven."""
    _dry(world, site, lambda v, q, u, t: abs(u) * (driving if u * v > 0 else driven))


def hysteresis(world: World, site: str, stiffness: float, width: float) -> None:
    """A spring of which half yields (Bouc-Wen), N m/rad and rad. Outside the catalogue."""

    def law(v, q, u, t, h, memory):
        slip = memory.get("slip", 0.0)
        memory["slip"] = slip + h * (v - 0.5 * (abs(v) * slip + v * abs(slip)) / width)
        return -stiffness * memory["slip"]

    push(world, site, law)


def cable_hysteresis(world: World, site: str, coefficient: float, stretch: float) -> None:
    """A cable that rubs on its guides in proportion to its tension, once it is stretched by `stretch` rad, and
    more when it is let go than when it is pulled. Outside the catalogue."""

    def law(v, q, u, t, h, memory):
        most = coefficient * abs(u) * (1.5 if u * v < 0 else 0.75)
        bent = memory.get("bent", 0.0) + h * v / stretch
        memory["bent"] = np.clip(bent, -1, 1)
        return -most * memory["bent"]

    push(world, site, law)


def spring(world: World, site: str, stiffness: float, rest: float) -> None:
    """A hose or return spring, N m/rad, slack at `rest` rad; added to the joint's own spring."""
    joint = world.spec.joint(site)
    degree = world.angle if joint.type == mujoco.mjtJoint.mjJNT_HINGE else 1.0
    own, total = joint.stiffness[0], joint.stiffness[0] + stiffness
    joint.springref = (own * joint.springref * degree + stiffness * rest) / total / degree
    joint.stiffness = np.array([total, 0, 0])


def hardening_spring(world: World, site: str, cubic: float) -> None:
    """A spring, N m/rad^3, that stiffens away from the joint's own rest position."""
    joint = world.spec.joint(site)
    joint.stiffness = joint.stiffness + np.array([0, 0, cubic])


def soft_stop(world: World, site: str, stiffness: float, limit: float) -> None:
    """A rubber stop, N m/rad, beyond `limit` rad on either side. Outside the catalogue."""
    push(world, site, lambda v, q, u, t, h, m: -stiffness * np.sign(q) * max(abs(q) - limit, 0.0))


def rotor_inertia(world: World, site: str, inertia: float) -> None:
    """More inertia on the motor's side than believed, kg m^2."""
    world.spec.joint(site).armature += inertia


def transmission_coupling(world: World, site: str, inertia: float, damping: float, friction: float) -> None:
    """Belts or gears to a neighbour run through this joint and drag it, of ``joint<-neighbour``."""
    name, _, other = site.partition("<-")

    def make(model, data):
        dof, source = model.joint(name).dofadr[0], model.joint(other).dofadr[0]
        applied, speeds, accelerations = data.qfrc_applied, data.qvel, data.qacc

        def before_step():
            speed = speeds[source]
            # The acceleration of the step before, which is short.
            applied[dof] -= inertia * accelerations[source] + damping * speed + friction * np.sign(speed)

        return before_step

    world.hooks.append(make)
