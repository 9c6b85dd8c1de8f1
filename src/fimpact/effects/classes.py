"""What an engineer would suspect: a kind of physics at a class of places, since the same parts sit at every joint."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from fimpact.effects import EFFECTS, sites, wiring
from fimpact.effects.base import RIGID_BODIES, Effect
from fimpact.effects.sites import ALL, DRAGS, WORLD

DRIVE = ("coulomb", "viscous", "rotor_inertia")  # what every gear with a motor has
RUBBING = ("coulomb", "viscous")  # what every bearing has
DRIVEN, FREE = "driven joint", "joint that nothing drives"

TITLES = {
    "coulomb": "Coulomb friction",
    "direction_dependent_coulomb": "direction-dependent Coulomb friction",
    "stribeck": "Stribeck friction",
    "dahl": "Dahl friction",
    "load_dependent_friction": "load-dependent friction",
    "viscous": "viscous friction",
    "quadratic_damping": "friction with the square of speed",
    "efficiency": "losses of driving and being driven",
    "com_shift": "centre of mass",
    "inertia": "scale of the inertia",
    "gain": "torque gain",
    "servo_kp": "position gain",
    "servo_kv": "speed gain",
    "saturation": "torque limit",
    "target_resolution": "resolution of the target",
    "supply_sag": "sagging supply",
    "gravity_compensation": "gravity that firmware compensates",
    "friction_compensation": "friction that firmware compensates",
    "cable_pull": "pull of a cable",
    "gravity_tilt": "tilt of the base",
    "gravity_scale": "size of gravity",
    "base_gives_way": "base that gives way",
    "ground_height": "height",
    "ground_tilt": "tilt",
    "rounded_edge": "rounded edges",
}

KINDS = {
    int(mujoco.mjtSensor.mjSENS_JOINTPOS): "encoder",
    int(mujoco.mjtSensor.mjSENS_JOINTVEL): "speed sensor",
    int(mujoco.mjtSensor.mjSENS_ACCELEROMETER): "accelerometer",
    int(mujoco.mjtSensor.mjSENS_GYRO): "gyroscope",
    int(mujoco.mjtSensor.mjSENS_FRAMEPOS): "camera or tracker",
    int(mujoco.mjtSensor.mjSENS_FRAMEQUAT): "camera or tracker",
    int(mujoco.mjtSensor.mjSENS_FORCE): "force sensor",
    int(mujoco.mjtSensor.mjSENS_TORQUE): "torque sensor",
    int(mujoco.mjtSensor.mjSENS_JOINTACTFRC): "torque sensor",
    int(mujoco.mjtSensor.mjSENS_ACTUATORFRC): "torque sensor",
}


@dataclass(frozen=True)
class KindClass:
    """A kind of physics at a class of places, tried as a whole: effects by name and site. order: in which engineers
    suspect, as `Effect.order`. compound: several kinds that come together."""

    name: str
    effects: tuple[tuple[str, str], ...]
    order: int
    compound: bool = False


def classes(model: mujoco.MjModel, channels: Sequence[str]) -> list[KindClass]:
    """List the classes of physics that `model` may lack: "geared drive" first, then in the order of suspicion."""
    found = [own for effect in EFFECTS.values() for own in _classes_of(effect, model, channels)]
    return _compound(found, model) + sorted(found, key=lambda own: own.order)


def _compound(found: list[KindClass], model) -> list[KindClass]:
    """Friction and rotor inertia together at the joints that motors drive, both frictions at those that none does."""
    driven = set(sites.driven(model))
    parts = [part for own in found for part in own.effects if part[0] in DRIVE and part[1] in driven]
    parts.sort(key=lambda part: DRIVE.index(part[0]))
    rubbing = [part for own in found for part in own.effects if part[0] in RUBBING and part[1] not in driven]
    made = [("geared drive", parts), ("dry and viscous friction", rubbing)]
    return [KindClass(name, tuple(own), RIGID_BODIES - 1, True) for name, own in made if own]


def _classes_of(effect: Effect, model, channels) -> list[KindClass]:
    groups: dict[str, list[str]] = {}
    for site in effect.sites(model, channels):
        groups.setdefault(_kind(effect, site, model), []).append(site)
    if effect.name == "rotor_inertia" and DRIVEN in groups:
        groups.pop(FREE, None)  # what nothing drives has no rotor
    return [
        KindClass(_name(effect, kind, places), tuple((effect.name, site) for site in places), effect.order)
        for kind, places in groups.items()
    ]


def _name(effect: Effect, kind: str, places: list[str]) -> str:
    title = TITLES.get(effect.name, effect.name.replace("_", " "))
    if effect.name == "rigid_body":
        return "rigid bodies" if len(places) > 1 else f"rigid body {places[0]}"
    if DRAGS in places[0]:
        return f"coupling of {' and '.join(sorted(places[0].split(DRAGS)))}"
    if places == [WORLD] or effect.sites in WHOLE:
        return title
    if places == [ALL]:
        return f"{title} of everything together"
    return f"{title} at {places[0] if len(places) == 1 else f'every {kind}'}"


def _kind(effect: Effect, site: str, model) -> str:
    """What kind of place a site is, in words; places of one kind are suspected together."""
    if site in (ALL, WORLD):
        return site
    if DRAGS in site:
        return " ".join(sorted(site.split(DRAGS)))
    for kind, of in PLACES.items():
        if effect.sites in of:
            return kind
    if effect.sites in JOINTS:
        return DRIVEN if site in sites.driven(model) else FREE if sites.driven(model) else "joint"
    if effect.sites in SENSORS:
        return _sensor(site, model)
    if effect.touching:
        return "surface" if site not in _pairs(model) else "contact"
    return "place"


def _sensor(site: str, model) -> str:
    kind = KINDS.get(int(model.sensor(wiring.base(site)).type[0]), "other sensor")
    return f"axis of every {kind}" if "[" in site else kind


def _pairs(model) -> set[str]:
    return {model.pair(i).name for i in range(model.npair)}


PLACES = {
    "body": (sites.bodies, sites.rounded),
    "base": (sites.standing,),
    "motor": (sites.actuators, sites.proportioned, sites.commands, sites.prompt),
    "servo": (sites.holding, sites.braking, sites.direct),
}
WHOLE = (sites.powered, sites.weighed)  # one place, which the title tells
JOINTS = (sites.joints, sites.hinges, sites.driven, sites.braked, sites.encoded)
SENSORS = (sites.columns, sites.scalable, sites.sensors, sites.turnable)
