"""The unit of what a recording measures, as far as its MJCF tells it."""

import mujoco

S = mujoco.mjtSensor
UNITS = {
    S.mjSENS_ACCELEROMETER: "m/s²", S.mjSENS_VELOCIMETER: "m/s", S.mjSENS_GYRO: "rad/s", S.mjSENS_FORCE: "N",
    S.mjSENS_TORQUE: "N m", S.mjSENS_TOUCH: "N", S.mjSENS_FRAMEPOS: "m", S.mjSENS_FRAMELINVEL: "m/s",
    S.mjSENS_FRAMEANGVEL: "rad/s", S.mjSENS_FRAMELINACC: "m/s²", S.mjSENS_SUBTREECOM: "m",
}  # fmt: skip
OF_JOINT = {
    S.mjSENS_JOINTPOS: ("rad", "m"), S.mjSENS_JOINTVEL: ("rad/s", "m/s"), S.mjSENS_JOINTACTFRC: ("N m", "N"),
}  # fmt: skip


def channel_unit(model: mujoco.MjModel, channel: str) -> str:
    """Unit of a channel, as far as its MJCF sensor tells it."""
    sensor = model.sensor(channel.partition("[")[0])
    kind = S(sensor.type[0])
    if kind in OF_JOINT:
        slides = model.jnt_type[sensor.objid[0]] == mujoco.mjtJoint.mjJNT_SLIDE
        return OF_JOINT[kind][int(slides)]
    return UNITS.get(kind, "")
