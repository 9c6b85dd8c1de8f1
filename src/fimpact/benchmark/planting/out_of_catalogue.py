"""Physics that no catalogue entry describes, and what can be planted altogether."""

import numpy as np

from fimpact.benchmark.planting import bodies, contacts, joints, servos, signals
from fimpact.benchmark.planting.ground_truth import World
from fimpact.benchmark.planting.plant import Plant, Values
from fimpact.benchmark.planting.planted_effects import (
    AXES,
    BLOCK,
    FREE,
    JOINTS,
    LEG,
    PLANTS,
    PRESS,
    ROBOTS_M,
    SERVO,
    J,
    M,
)

ARMS = (FREE, PRESS)


def _place(rng, rig, motion, site) -> Values:
    """Somewhere in the middle of a joint's planned travel."""
    begun = motion.start[:, rig.naive.joint(site).qposadr[0]]
    return {"centre": rng.uniform(-0.3, 0.3) + float(np.mean(begun)), "width": 0.15}


def _somewhere(rng, rig, motion, site) -> Values:
    x, y, z = (
        (rng.uniform(-0.3, 0.3), 0.0, 0.0) if rig.plane == "xz" else (rng.uniform(0.1, 0.5), rng.uniform(0.2, 0.6), 0.0)
    )
    return {"x": x, "y": y, "z": z, "reach": 0.15}


def _blow(rng, rig, motion, site) -> Values:
    share = rng.uniform(0.2, 0.5) if rig.throws() else rng.uniform(0.3, 0.7)
    return {"angle": rng.uniform(0, 2 * np.pi), "time": share * rig.duration, "width": rig.duration / 12}


def _swing(rng, rig, motion, site) -> Values:
    return {"period": rng.uniform(0.4, 1.0), "phase": rng.uniform(0, 2 * np.pi)}


def _heat(rng, rig, motion, site) -> Values:
    """What warms the grease by much in one run, J."""
    return {"heat": rng.uniform(0.2, 0.6) * rig.size}


STRANGERS = {
    "rough_spot": Plant(
        joints.rough_spot, JOINTS, lambda size, **shape: {"torque": size, **shape}, 0.05, 3.0, _place, power=1
    ),
    "warming": Plant(joints.warming, dict.fromkeys(ARMS, J), lambda size: {"torque": size, "time": 0.5}, 0.05, 1.0),
    "cross_coupling": Plant(
        signals.cross_coupling,
        dict.fromkeys(ARMS, M) | {AXES: ROBOTS_M[AXES][3:]},
        lambda size: {"coefficient": size},
        0.02,
        0.5,
        signed=True,
    ),
    "varying_gain": Plant(
        signals.varying_gain, dict.fromkeys(ARMS, M), lambda size, **shape: {"depth": size, **shape}, 0.03, 0.6, _swing
    ),
    "soft_stop": Plant(joints.soft_stop, {FREE: J}, lambda size: {"stiffness": size, "limit": 0.5}, 0.5, 40.0),
    "hysteresis": Plant(
        joints.hysteresis, dict.fromkeys(ARMS, J), lambda size: {"stiffness": size, "width": 0.2}, 0.2, 10.0
    ),
    "pendulum": Plant(
        bodies.pendulum,
        {FREE: ("link_3",), BLOCK: ("block",)},
        lambda size, rate: {"mass": size, "rate": rate},
        0.02,
        0.3,
        lambda rng, rig, motion, site: {"rate": rng.uniform(15, 40)},
    ),
    "magnet": Plant(
        bodies.magnet,
        {FREE: ("link_3",), PRESS: ("link_3",), BLOCK: ("block",)},
        lambda size, **shape: {"force": size, **shape},
        0.5,
        30.0,
        _somewhere,
    ),
    "gust": Plant(
        bodies.gust,
        {FREE: ("link_2", "link_3"), PRESS: ("link_3",), BLOCK: ("block",)},
        lambda size, **shape: {"force": size, **shape},
        0.2,
        10.0,
        _blow,
    ),
    "sticky": Plant(
        contacts.sticky,
        {BLOCK: ("mat",), PRESS: ("wall",)},
        lambda size: {"force": size, "reach": 0.02},
        0.5,
        20.0,
        mode="contact",
    ),
    "wavy_ground": Plant(
        contacts.wavy_ground,
        {BLOCK: ("mat",), PRESS: ("wall",)},
        lambda size: {"height": size, "length": 0.06},
        5e-4,
        0.02,
        mode="contact",
    ),
    "self_heating": Plant(
        joints.self_heating, JOINTS, lambda size, **shape: {"damping": size, **shape}, 0.05, 1.5, _heat, power=1
    ),
    "cable_hysteresis": Plant(
        joints.cable_hysteresis, JOINTS, lambda size: {"coefficient": size, "stretch": 0.1}, 0.05, 1.0
    ),
    "tilted_axis": Plant(
        bodies.tilted_axis,
        {FREE: J[1:], AXES: JOINTS[AXES][1:5], SERVO: JOINTS[SERVO][1:5]},
        lambda size: {"tilt": size},
        0.01,
        0.4,
        signed=True,
    ),
    "wound_integral": Plant(
        servos.wound_integral,
        {name: ROBOTS_M[name] for name in (SERVO, LEG)},
        lambda size, rate: {"limit": size, "rate": rate},
        0.03,
        1.5,
        lambda rng, rig, motion, site: {"rate": rng.uniform(2, 6)},
        power=1,
    ),
    "loose_tool": Plant(
        bodies.loose_tool,
        {FREE: ("link_3",), AXES: ("link_6",), SERVO: ("link_5",), LEG: ("thigh",)},
        lambda size, gap: {"share": size, "gap": gap},
        0.1,
        0.8,
        lambda rng, rig, motion, site: {"gap": rng.uniform(0.01, 0.04) * (0.5 if rig.name == SERVO else 1.0)},
        stiff=4,
    ),
    "bent_scale": Plant(
        signals.bent_scale,
        {FREE: ("encoder_2", "encoder_3"), PRESS: ("wrist_force[1]",)},
        lambda size: {"coefficient": size},
        1e-3,
        0.1,
    ),
}


def known(name: str) -> Plant:
    """The plant `name`, of the catalogue or of those outside it. Raises ValueError listing what there is."""
    everything = PLANTS | STRANGERS
    if name not in everything:
        raise ValueError(f"nothing called {name!r} can be planted; there are {', '.join(everything)}")
    return everything[name]


def plant(world: World, name: str, site: str, values: Values) -> None:
    """Put the effect or stranger `name` into `world`."""
    known(name).put(world, site, **values)
