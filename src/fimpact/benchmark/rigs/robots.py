"""Three rigs like the robots that people have: six axes with torque motors, six servos, a leg on a rail.

What their naive models have wrong without lacking it: masses by 10 %, centres of mass by 5 mm, inertias and the known
viscous friction by 20 %, all declared as unknown.
"""

from dataclasses import replace

import numpy as np

from fimpact.benchmark.rigs.rig import Rig
from fimpact.recordings import Unknown

COUNT = 2 * np.pi / 4096  # rad, of a servo's encoder
MISJUDGED = {"mass": 0.1, "com_x": 0.005, "com_y": 0.005, "com_z": 0.005, "inertia": 0.2, "damping": 0.2}
AXES = ("com_x", "com_y", "com_z")  # misjudged by metres, where an `Unknown` wants a share of what is not zero


def _known_as(rig: Rig, places: dict[str, str]) -> Rig:
    """The rig with its unknowns by the names of their places, those of one place in one string."""
    pairs = [(site, field) for site, fields in places.items() for field in fields.split()]
    return replace(rig, unknowns=tuple(Unknown(field, site, _sd(rig, site, field)) for site, field in pairs))


def _sd(rig: Rig, site: str, field: str) -> float:
    at = abs(rig.naive.body(site).ipos[AXES.index(field)]) if field in AXES else 0.0
    return float(MISJUDGED[field] / (at or 1.0))


ENCODERS = tuple(f"encoder_{i}" for i in range(1, 7))
JOINTS = {f"joint_{i}": "damping" for i in range(1, 7)}
LINKS = {
    "link_1": "inertia",
    "link_2": "mass com_x com_z inertia",
    "link_3": "mass com_x com_z inertia",
    "link_4": "mass com_y",
    "link_5": "mass com_z",
    "link_6": "mass com_z",
}
SIX_AXIS = _known_as(
    Rig(
        name="six_axis",
        period=0.004,
        fine=40,
        coarse=4,
        channels=ENCODERS,
        noise=np.full(6, 4e-5),
        quantum=np.full(6, 2 * np.pi / 2**17),
        unknowns=(),
        start_sd=np.full(12, np.inf),
        window=0.2,
        duration=1.0,
        training=3,
        held_out=2,
        disturbance=np.array([1.0, 1.0, 0.6, 0.15, 0.15, 0.1]),
        plane="",
        size=20.0,
        current=np.array([0.6, 0.6, 0.4, 0.1, 0.1, 0.07]),
        stiff=np.array([900.0, 900.0, 600.0, 80.0, 80.0, 40.0]),
        damp=np.array([120.0, 120.0, 80.0, 6.0, 6.0, 3.0]),
        limit=np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0]),
    ),
    LINKS | JOINTS,
)
SIX_SERVO = _known_as(
    replace(
        SIX_AXIS,
        name="six_servo",
        period=0.02,
        fine=100,
        coarse=5,
        noise=np.full(6, COUNT / 4),
        quantum=np.full(6, COUNT),
        window=0.4,
        duration=2.4,
        disturbance=np.array([1.0, 1.0, 0.8, 0.5, 0.3, 0.2]),
        size=1.0,
        current=np.zeros(0),
        stiff=np.zeros(0),
    ),
    {"link_2": "mass com_z", "link_3": "mass com_x inertia", "link_4": "mass com_x", "link_5": "mass com_x inertia"}
    | JOINTS,
)
LEG = _known_as(
    Rig(
        name="leg",
        period=0.005,
        fine=50,
        coarse=5,
        channels=("rail_encoder", "hip_encoder", "knee_encoder", "imu[2]"),
        noise=np.array([4e-4, 3e-4, 3e-4, 0.3]),
        quantum=np.array([1e-4, 2 * np.pi / 2**14, 2 * np.pi / 2**14, 0.02]),
        unknowns=(),
        start_sd=np.full(6, np.inf),
        window=0.15,
        duration=0.75,
        training=3,
        held_out=2,
        disturbance=np.array([1.0, 0.1, 0.1]),
        plane="xz",
        size=2.0,
    ),
    {
        "trunk": "mass",
        "thigh": "mass com_x com_z inertia",
        "shank": "mass com_z inertia",
        "hip": "damping",
        "knee": "damping",
    },
)
