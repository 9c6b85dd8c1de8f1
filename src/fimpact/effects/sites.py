"""Where an effect can sit: joints, actuators, bodies, contacts, channels. What has no name is skipped."""

from collections.abc import Sequence

import mujoco
import numpy as np

from fimpact.effects.touching import can_touch, pairs_of, partners, round_geoms
from fimpact.effects.wiring import (
    HINGE,
    ON_JOINT,
    PROPORTIONAL,
    SLIDE,
    base,
    drives,
    encoded_joint,
    fed_back,
    is_affine,
)

ALL, WORLD = "all", "world"
DRAGS = "<-"  # between a joint and the neighbour that drags it
MESH = int(mujoco.mjtGeom.mjGEOM_MESH)


def joints(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Hinge and slide joints, apart from those that only describe how a body flies."""
    kinds = (HINGE, SLIDE)
    return [
        j.name for j in map(model.joint, range(model.njnt)) if j.name and j.type[0] in kinds and not _flies(model, j)
    ]


def hinges(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Hinge joints among `joints`."""
    return [name for name in joints(model) if model.joint(name).type[0] == HINGE]


def driven(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Joints that an actuator of `actuators` drives."""
    return [name for name in joints(model) if drives(model, name)]


def neighbours(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """``a<-b`` and ``b<-a`` for each driven joint a and the next driven joint b towards the base."""
    names = driven(model)
    pairs = [(name, _before(model, name, names)) for name in names]
    return [place for a, b in pairs if b for place in (f"{a}{DRAGS}{b}", f"{b}{DRAGS}{a}")]


def standing(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Bodies on the world, fixed or on joints, from which a mechanism rises, if there is gravity."""
    if not np.any(model.opt.gravity):
        return []
    held = {model.joint(name).id for name in joints(model)}
    first = {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in held}
    rising = [body for body in sorted(first) if held.issuperset(np.flatnonzero(model.jnt_bodyid == body).tolist())]
    return [model.body(body).name for body in rising if model.body(body).name]


def holding(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Servos that hold a position."""
    return [name for name in actuators(model) if fed_back(model, name)[0]]


def braking(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Servos with a gain on their speed."""
    return [name for name in actuators(model) if fed_back(model, name)[1]]


def proportioned(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Actuators whose force has a scale beside the gain of a servo that has only one: motors, servos with two gains."""
    return [name for name in actuators(model) if len(set(fed_back(model, name))) == 1]


def direct(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Servos that hold the position of a hinge or slide joint, without dynamics of their own or a limit at it."""
    free = [joint for joint in joints(model) if not model.jnt_actfrclimited[model.joint(joint).id]]
    owned = {i for joint in free for i in drives(model, joint) if model.actuator_gaintype[i] == PROPORTIONAL[0]}
    return [name for name in holding(model) if name in prompt(model) and model.actuator(name).id in owned]


def braked(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Driven joints that have friction in the model."""
    rubs = (model.dof_frictionloss > 0) | (model.dof_damping > 0)
    return [name for name in driven(model) if rubs[model.joint(name).dofadr[0]]]


def powered(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """The motors of all driven joints together, if those are hinges."""
    found = driven(model)
    return [ALL] if found and set(found) <= set(hinges(model)) else []


def weighed(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """The motors of all driven joints together, if there is gravity and nothing between them and the base is free."""
    found = {model.joint(name).id for name in driven(model)}
    roots = model.body_rootid[model.jnt_bodyid]
    alike = set(np.flatnonzero(np.isin(roots, roots[list(found)])).tolist())
    return [ALL] if found and alike == found and np.any(model.opt.gravity) else []


def encoded(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """Driven joints whose position is measured."""
    shown = {encoded_joint(model, channel) for channel in channels}
    return [name for name in driven(model) if name in shown]


def actuators(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Actuators whose force is an affine function of the command, length and velocity."""
    return [model.actuator(i).name for i in range(model.nu) if model.actuator(i).name and is_affine(model, i)]


def commands(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Every actuator, and "all" of them where there are several."""
    names = [model.actuator(i).name for i in range(model.nu)]
    return [name for name in names if name] + [ALL] * (len(names) > 1)


def prompt(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Actuators without dynamics of their own, and "all" of them where there are several and no other."""
    dynamic = int(mujoco.mjtDyn.mjDYN_NONE)
    names = [name for name in actuators(model) if model.actuator(name).dyntype[0] == dynamic]
    return names + [ALL] * (1 < len(names) == model.nu)


def bodies(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Moving bodies with mass."""
    moving = (model.body_weldid != 0) & (model.body_mass > 0)
    return [model.body(i).name for i in np.flatnonzero(moving) if model.body(i).name]


def grounds(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Geoms fixed to the world that something moving can touch; meshes, whose frame MuJoCo moves, are left out."""
    if not can_touch(model):
        return []
    fixed = np.flatnonzero((model.body_weldid[model.geom_bodyid] == 0) & (model.geom_type != MESH))
    named = [int(i) for i in fixed if model.geom(i).name]
    return [model.geom(i).name for i in named if pairs_of(model, i) or partners(model, i)]


def contacts(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Contact pairs, and the grounds that stand for several pairs or for contacts that no pair lists."""
    if not can_touch(model):
        return []
    named = [model.pair(i).name for i in range(model.npair)]
    ids = {name: model.geom(name).id for name in grounds(model)}
    many = [name for name, i in ids.items() if len(pairs_of(model, i)) > 1 or partners(model, i)]
    return [name for name in named if name] + [name for name in many if name not in named]


def rounded(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """Moving bodies that touch something with spheres or capsules."""
    return [name for name in bodies(model) if round_geoms(model, model.body(name).id)]


def columns(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """Channels, apart from components of a quaternion, which have no bias or scale of their own."""
    quaternion = int(mujoco.mjtDataType.mjDATATYPE_QUATERNION)
    return [name for name in channels if model.sensor(base(name)).datatype[0] != quaternion]


def scalable(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """Channels, and the sensors of which several components are measured."""
    kept = columns(model, channels)
    names = [base(name) for name in kept]
    return kept + [name for name in dict.fromkeys(names) if names.count(name) > 1]


def sensors(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """Sensors by name, and "all" where there are several."""
    names = list(dict.fromkeys(map(base, channels)))
    return names + [ALL] * (len(names) > 1)


def everything(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """All channels together."""
    return [ALL] if len(channels) else []


def turnable(model: mujoco.MjModel, channels: Sequence[str]) -> list[str]:
    """Sensors of three components on an MJCF site, of which at least two are measured."""
    names = list(map(base, channels))
    on_site = int(mujoco.mjtObj.mjOBJ_SITE)
    fits = {n: model.sensor(n).dim[0] == 3 and model.sensor(n).objtype[0] == on_site for n in names}
    return [name for name in dict.fromkeys(names) if fits[name] and names.count(name) > 1]


def world(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """The world as a whole, if anything in it moves."""
    return [WORLD] if model.nv else []


def heavy(model: mujoco.MjModel, channels: Sequence[str] = ()) -> list[str]:
    """The world as a whole, if it has gravity."""
    return [WORLD] if model.nv and np.any(model.opt.gravity) else []


def measured_by(channels: Sequence[str], site: str) -> list[int]:
    """Columns of a channel, of every component of a sensor, or of "all"."""
    return [i for i, name in enumerate(channels) if site in (ALL, name, base(name))]


def _flies(model, joint) -> bool:
    """Two undriven slides on one body are coordinates of a flight, not guides with friction."""
    body = model.joint(joint.id).bodyid[0]
    own = np.flatnonzero(model.jnt_bodyid == body)
    pushed = np.isin(own, model.actuator_trnid[model.actuator_trntype == ON_JOINT, 0])
    return bool(np.count_nonzero(model.jnt_type[own] == SLIDE) > 1 and not pushed.any())


def _before(model, joint: str, among: list[str]) -> str:
    """The next of the joints `among` before `joint` on its body or towards the base, or ""."""
    body, last = model.joint(joint).bodyid[0], model.joint(joint).id
    while body:
        own = [i for i in np.flatnonzero(model.jnt_bodyid == body)[::-1] if i < last]
        found = [name for name in (model.joint(i).name for i in own) if name in among]
        if found:
            return found[0]
        body = model.body_parentid[body]
    return ""
