"""Where simulators keep what an effect is: the field of MJCF, of URDF, and of PhysX and Isaac.

PhysX reads its fields from USD, which counts angles in degrees: stiffness and damping of a hinge are per degree there.
Isaac Lab's actuators, whose keywords are named beside them, count in radians as MuJoCo does.
"""

from dataclasses import asdict, dataclass

import mujoco

from fimpact.effects.base import Effect
from fimpact.effects.sites import DRAGS

NONE = "none; use improved.py"
LOG = "none; correct the log"  # an error of what was recorded is none of the robot
SIMULATORS = {"mjcf": "MJCF", "urdf": "URDF", "physx": "PhysX / Isaac (USD)"}


@dataclass(frozen=True)
class Fields:
    """Names of fields. "{axis}" stands for angular or linear, "{deg}" for the factor that a hinge has in USD."""

    mjcf: str = NONE
    urdf: str = NONE
    physx: str = NONE


JOINT, DRIVE = "physxJointAxis:{axis}:", "drive:{axis}:physics:"
INERTIAL = "<inertial> "
GAZEBO = "none; Gazebo: "
FRICTION = (
    JOINT + "staticFrictionEffort and dynamicFrictionEffort, not physxJoint:jointFriction, which has no unit; "
    "Isaac Lab: friction and dynamic_friction"
)
VISCOUS = JOINT + "viscousFrictionCoefficient = damping{deg}; Isaac Lab: viscous_friction"

FIELDS = {
    "coulomb": Fields("joint frictionloss", "<dynamics friction>", FRICTION),
    "viscous": Fields("joint damping", "<dynamics damping>", VISCOUS),
    "quadratic_damping": Fields("joint damping, its second number"),
    "direction_dependent_coulomb": Fields(
        "joint frictionloss = their mean; the motor's biasprm[0] = −(forward − backward) / (2 gear)",
        "<dynamics friction> = their mean; none for the difference",
        "as coulomb = their mean; none for the difference",
    ),
    "stribeck": Fields(
        physx=JOINT + "staticFrictionEffort = coulomb + excess, dynamicFrictionEffort = coulomb; none for the speed"
    ),
    "joint_elasticity": Fields(
        "none; use improved.py, or a second joint of stiffness 1 / compliance between motor and link"
    ),
    "backlash": Fields("none; use improved.py, or a second joint of range ± gap / 2 between motor and link"),
    "gain": Fields(
        "actuator gainprm and biasprm × (1 + change)",
        "none; scale the commands",
        "efforts: none, scale them; servos: " + DRIVE + "stiffness, damping and maxForce × (1 + change)",
    ),
    "saturation": Fields(
        "actuator forcerange",
        "<limit effort> = limit × gear",
        DRIVE + "maxForce = limit × gear; Isaac Lab: effort_limit_sim, of explicit actuators effort_limit",
    ),
    "command_delay": Fields(
        "actuator delay, with nsample; no shorter than a time step, so improved.py is finer",
        "none; send commands later",
        "none; Isaac Lab: DelayedPDActuatorCfg, min_delay = max_delay = delay / time step of the physics",
    ),
    "actuator_lag": Fields(
        'actuator dyntype="filterexact" dynprm[0] = time actearly="true"; of a position servo, timeconst',
        "none; filter the commands",
        "none; filter the commands",
    ),
    "rotor_inertia": Fields(
        "joint armature", "none; Drake: <drake:rotor_inertia>", JOINT + "armature; Isaac Lab: armature"
    ),
    "servo_kp": Fields(
        "actuator kp × (1 + change): gainprm[0] and −biasprm[1]",
        "none; the gain p of the controller",
        DRIVE + "stiffness = kp{deg} × (1 + change); Isaac Lab: stiffness",
    ),
    "servo_kv": Fields(
        "actuator kv × (1 + change): −biasprm[2], and gainprm[0] of a <velocity> servo",
        "none; the gain d of the controller",
        DRIVE + "damping = kv{deg} × (1 + change); Isaac Lab: damping",
    ),
    "gravity_compensation": Fields(
        "body gravcomp = share, of every body that the joints carry",
        "none; the controller's gravity compensation",
        "none but for all of it: physxRigidBody:disableGravity of every link",
    ),
    "friction_compensation": Fields(
        "joint frictionloss and damping × (1 − share)",
        "<dynamics friction> and <dynamics damping> × (1 − share)",
        "staticFrictionEffort, dynamicFrictionEffort and viscousFrictionCoefficient of "
        + JOINT[:-1]
        + " × (1 − share)",
    ),
    "target_resolution": Fields("none; round the commands", "none; round the commands", "none; round the commands"),
    "torque_offset": Fields(
        'actuator biastype="affine" biasprm[0]', "none; add it to the commands", "none; add it to the efforts"
    ),
    "rigid_body": Fields(
        "body inertial mass, pos and diaginertia or fullinertia",
        INERTIAL + "<mass value>, <origin xyz>, <inertia>",
        "physics:mass, physics:centerOfMass, physics:diagonalInertia, physics:principalAxes",
    ),
    "com_shift": Fields("body inertial pos", INERTIAL + "<origin xyz>", "physics:centerOfMass"),
    "inertia": Fields(
        "body inertial diaginertia or fullinertia × (1 + change)",
        INERTIAL + "<inertia> × (1 + change)",
        "physics:diagonalInertia × (1 + change)",
    ),
    "spring": Fields(
        "joint stiffness and springref",
        physx=DRIVE + "stiffness = stiffness{deg} and targetPosition = rest{turn}, where nothing else drives the joint",
    ),
    "hardening_spring": Fields("joint stiffness, its third number"),
    "cable_pull": Fields("tendon spatial stiffness", physx="physxTendon:INSTANCE:stiffness of a spatial tendon"),
    "gravity_tilt": Fields("option gravity", "none; turn the root's <origin rpy>", "physics:gravityDirection"),
    "gravity_scale": Fields("option gravity", "none; set in the simulator", "physics:gravityMagnitude"),
    "linear_drag": Fields(physx="physxRigidBody:linearDamping = coefficient / mass, 1/s"),
    "ground_height": Fields("geom pos", "<collision> <origin xyz>", "xformOp:translate"),
    "ground_tilt": Fields("geom quat", "<collision> <origin rpy>", "xformOp:orient"),
    "sliding_friction": Fields(
        "geom or pair friction[0]",
        GAZEBO + "<mu1> and <mu2>",
        "physics:staticFriction and physics:dynamicFriction of the material",
    ),
    "contact_stiffness": Fields(
        "geom or pair solref", GAZEBO + "<kp>", "physxMaterial:compliantContactStiffness, which is not scaled by mass"
    ),
    "contact_damping": Fields(
        "geom or pair solref", GAZEBO + "<kd>", "physxMaterial:compliantContactDamping, which is not scaled by mass"
    ),
    "rolling_friction": Fields('geom or pair friction[2], with condim="6"'),
    "rounded_edge": Fields("geom size, and pair margin of a box", "<collision> <geometry>", "the collider's geometry"),
    "misalignment": Fields("quat of the sensor's site", "<origin rpy> of the sensor's joint", "xformOp:orient"),
    "sensor_delay": Fields("sensor delay, with nsample; else correct the log", LOG, LOG),
    "sensor_bias": Fields(LOG, LOG, LOG),
    "sensor_scale": Fields(LOG, LOG, LOG),
    "clock_drift": Fields(LOG, LOG, LOG),
}
FIELDS["payload"] = FIELDS["rigid_body"]


def fields_of(effect: Effect, spec: mujoco.MjSpec | None = None, site: str = "") -> dict[str, str]:
    """Name the field of each simulator in `SIMULATORS`; at a place of `spec`, as its joint has it, else of a hinge."""
    slides = spec is not None and _slides(spec, site)
    axis, degree, turn = ("linear", "", "") if slides else ("angular", " × π/180", " × 180/π")
    texts = asdict(FIELDS.get(effect.name, Fields()))
    return {name: text.format(axis=axis, deg=degree, turn=turn) for name, text in texts.items()}


def _slides(spec: mujoco.MjSpec, site: str) -> bool:
    """Whether `site` is a slide joint, or the motor of one."""
    motor = spec.actuator(site)
    joint = spec.joint(motor.target if motor else site.partition(DRAGS)[0])
    return bool(joint) and joint.type == mujoco.mjtJoint.mjJNT_SLIDE
