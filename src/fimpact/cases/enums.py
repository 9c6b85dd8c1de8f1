"""MuJoCo's enumerations as numbers: ``numpy.int32(0) in (mjtTrn.mjTRN_JOINT,)`` is False, although they are equal."""

import mujoco


def _numbers(enum, names: str) -> list[int]:
    return [int(getattr(enum, name)) for name in names.split()]


FREE, BALL, SLIDE, HINGE = _numbers(mujoco.mjtJoint, "mjJNT_FREE mjJNT_BALL mjJNT_SLIDE mjJNT_HINGE")
JOINTPOS, JOINTVEL = _numbers(mujoco.mjtSensor, "mjSENS_JOINTPOS mjSENS_JOINTVEL")
FRAMEPOS, FRAMEQUAT, BALLQUAT = _numbers(mujoco.mjtSensor, "mjSENS_FRAMEPOS mjSENS_FRAMEQUAT mjSENS_BALLQUAT")
FRAMELINVEL, FRAMEANGVEL = _numbers(mujoco.mjtSensor, "mjSENS_FRAMELINVEL mjSENS_FRAMEANGVEL")
VELOCIMETER, GYRO, ACCELEROMETER = _numbers(mujoco.mjtSensor, "mjSENS_VELOCIMETER mjSENS_GYRO mjSENS_ACCELEROMETER")
JOINTACTFRC, ACTPOS, ACTVEL, ACTFRC = _numbers(
    mujoco.mjtSensor, "mjSENS_JOINTACTFRC mjSENS_ACTUATORPOS mjSENS_ACTUATORVEL mjSENS_ACTUATORFRC"
)
FRAMELINACC, FRAMEANGACC, BALLANGVEL = _numbers(
    mujoco.mjtSensor, "mjSENS_FRAMELINACC mjSENS_FRAMEANGACC mjSENS_BALLANGVEL"
)
RANGEFINDER, SUBTREECOM, SUBTREELINVEL, CLOCK = _numbers(
    mujoco.mjtSensor, "mjSENS_RANGEFINDER mjSENS_SUBTREECOM mjSENS_SUBTREELINVEL mjSENS_CLOCK"
)
FORCE, TORQUE, TOUCH = _numbers(mujoco.mjtSensor, "mjSENS_FORCE mjSENS_TORQUE mjSENS_TOUCH")
AT_JOINT = _numbers(mujoco.mjtTrn, "mjTRN_JOINT mjTRN_JOINTINPARENT")
NO_BIAS, AFFINE = _numbers(mujoco.mjtBias, "mjBIAS_NONE mjBIAS_AFFINE")
(FIXED,) = _numbers(mujoco.mjtGain, "mjGAIN_FIXED")
BODY, XBODY, SITE = _numbers(mujoco.mjtObj, "mjOBJ_BODY mjOBJ_XBODY mjOBJ_SITE")
EQUALITY, LAST_FRICTION = _numbers(mujoco.mjtConstraint, "mjCNSTR_EQUALITY mjCNSTR_FRICTION_TENDON")
PLAIN_STATES = _numbers(mujoco.mjtDyn, "mjDYN_NONE mjDYN_FILTER mjDYN_FILTEREXACT")  # their state follows the command
