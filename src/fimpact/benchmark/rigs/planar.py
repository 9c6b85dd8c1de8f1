"""Three planar rigs: an arm that moves freely, the same pressing on a wall, a block that is thrown."""

from dataclasses import replace

import numpy as np

from fimpact.benchmark.rigs.rig import Rig
from fimpact.recordings import Unknown

ENCODERS = tuple(f"encoder_{i}" for i in (1, 2, 3))
ARM = Rig(
    name="arm_free",
    period=0.005,
    fine=20,
    coarse=1,
    channels=ENCODERS,
    noise=np.full(3, 2e-3),
    quantum=np.full(3, 2 * np.pi / 2**13),
    unknowns=tuple(Unknown("mass", f"link_{i}", 0.12) for i in (1, 2, 3))
    + tuple(Unknown("damping", f"joint_{i}", 0.2) for i in (1, 2, 3)),
    start_sd=np.full(6, np.inf),
    window=0.4,
    duration=2.0,
    training=8,
    held_out=4,
    disturbance=np.array([1.0, 0.6, 0.3]),
    stiff=np.array([25.0, 12.0, 3.0]),
    damp=np.array([3.0, 1.5, 0.2]),
    limit=np.full(3, 6.0),
)
PRESSING = replace(
    ARM,
    name="arm_contact",
    fine=20,
    window=0.2,
    duration=1.6,
    training=7,
    held_out=3,
    coarse=2,
    channels=(*ENCODERS, "wrist_force[0]", "wrist_force[1]"),
    noise=np.array([2e-3, 2e-3, 2e-3, 0.4, 0.4]),
    quantum=np.array([*ARM.quantum, 0.1, 0.1]),
)
BLOCK = Rig(
    name="block",
    period=0.0025,
    fine=20,
    coarse=2,
    channels=("camera_x", "camera_z", "camera_pitch", "imu[0]", "imu[2]"),
    noise=np.array([1e-3, 1e-3, 5e-3, 2.0, 2.0]),
    quantum=np.array([2e-4, 2e-4, 1e-3, 0.05, 0.05]),
    unknowns=(Unknown("inertia", "block", 0.12), Unknown("com_x", "block", 0.002), Unknown("com_z", "block", 0.002)),
    start_sd=np.array([2e-3, 2e-3, 0.01, 0.05, 0.05, 0.3]),
    window=0.125,
    duration=0.5,
    training=18,
    held_out=6,
    disturbance=np.array([1.0, 1.0, 0.03]),
    plane="xz",
)
