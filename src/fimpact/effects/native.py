"""Writing what a law changed in a compiled model back into its MjSpec, so that the exported MJCF is the law."""

import copy
from collections.abc import Callable

import mujoco
import numpy as np

HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
UNSET = np.r_[np.nan, np.zeros(5)]
STIFFEST = 0.9999  # MuJoCo's largest constraint impedance (mjMAXIMP)


def editable(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The compiled `spec`, without the shortcut for bodies whose mass lies in their origin.

    MuJoCo refuses a moved centre of mass where it took that shortcut, so a model whose fields are edited needs this.
    """
    kept = [body.simple for body in spec.bodies]
    for body in spec.bodies:
        body.simple = 0
    model = spec.compile()
    for body, simple in zip(spec.bodies, kept, strict=True):
        body.simple = simple
    return model


def exporting(law: Callable) -> Callable:
    """The exporter of a law that edits model fields: ``export(spec, site, **values)`` writes them into `spec`."""

    def export(spec: mujoco.MjSpec, site: str, **values: float) -> None:
        before = editable(spec)
        after = copy.copy(before)
        law(after, site, **values)
        _write(spec, before, after)

    return export


def exact_dry_friction(model: mujoco.MjModel, dof: int) -> None:
    """Make MuJoCo's dry friction of degree of freedom `dof` turn over within one time step of `model.opt.timestep`.

    At MuJoCo's default `solreffriction` it turns over some 10 ms before the speed does, and creeps under load.
    """
    model.dof_solref[dof] = 2 * model.opt.timestep, 1.0  # the tightest that MuJoCo keeps (refsafe)
    model.dof_solimp[dof, :2] = STIFFEST


def write_inferred_fields(spec: mujoco.MjSpec) -> None:
    """Write into `spec` what the compiler works out from masses, the damping of servos (dampratio) and the springs of
    joints (springdamper), so that other masses leave them as they are."""
    model = spec.compile()
    for joint in spec.joints:
        if np.any(joint.springdamper):
            _put_spring(joint, model, joint.id)
            _put_dof(joint, model, int(model.jnt_dofadr[joint.id]))
            joint.springdamper = np.zeros(2)
    for actuator in spec.actuators:
        if actuator.biasprm[2] > 0:
            actuator.biasprm = model.actuator_biasprm[actuator.id]


def _write(spec, before, after) -> None:
    spec.option.gravity = after.opt.gravity
    if _rows(before, after, *INERTIAL, "geom_size"):
        _freeze(spec, after)
    for arrays, elements, owner, put in TABLE:
        by_id = {element.id: element for element in getattr(spec, elements)}
        for row in _rows(before, after, *arrays):
            put(by_id[owner(after, row)], after, row)


def _rows(before, after, *arrays: str) -> list[int]:
    different = [np.flatnonzero(np.any(_flat(before, a) != _flat(after, a), axis=1)) for a in arrays]
    return sorted(set(np.concatenate(different).tolist()))


def _flat(model, array: str) -> np.ndarray:
    values = getattr(model, array)
    return values.reshape(len(values), int(np.prod(values.shape[1:])))


def _freeze(spec, model) -> None:
    """Give every moving body its mass in so many words where the compiler would infer or rescale it."""
    compiler = spec.compiler
    inferred = compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if inferred or compiler.settotalmass > 0:
        for body in spec.bodies[1:]:
            _put_inertial(body, model, body.id)
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        compiler.settotalmass = -1


def _put_dof(joint, model, row: int) -> None:
    joint.frictionloss = model.dof_frictionloss[row]
    joint.solref_friction, joint.solimp_friction = model.dof_solref[row], model.dof_solimp[row]
    joint.damping = np.r_[model.dof_damping[row], model.dof_dampingpoly[row]]
    joint.armature = model.dof_armature[row]


def _put_spring(joint, model, row: int) -> None:
    joint.stiffness = np.r_[model.jnt_stiffness[row], model.jnt_stiffnesspoly[row]]


def _put_rest(joint, model, row: int) -> None:
    degrees = joint.compiler.degree and model.jnt_type[joint.id] == HINGE
    joint.springref = np.degrees(model.qpos_spring[row]) if degrees else model.qpos_spring[row]


def _put_actuator(actuator, model, row: int) -> None:
    actuator.gainprm, actuator.biasprm = model.actuator_gainprm[row], model.actuator_biasprm[row]
    actuator.biastype = mujoco.mjtBias(model.actuator_biastype[row])
    if model.actuator_forcelimited[row]:
        actuator.forcelimited, actuator.forcerange = 1, model.actuator_forcerange[row]


def _put_inertial(body, model, row: int) -> None:
    body.explicitinertial, body.fullinertia = True, UNSET
    body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.mass, body.ipos = model.body_mass[row], model.body_ipos[row]
    body.inertia, body.iquat = model.body_inertia[row], model.body_iquat[row]


def _put_shape(geom, model, row: int) -> None:
    if geom.frame is not None:
        raise ValueError(f"geom {geom.name!r} sits in a <frame>, which cannot be edited; save the compiled XML first")
    geom.pos, geom.quat, geom.size = model.geom_pos[row], model.geom_quat[row], model.geom_size[row]
    geom.alt.type, geom.fromto = mujoco.mjtOrientation.mjORIENTATION_QUAT, UNSET
    if model.geom_bodyid[row]:
        _put_inertial(geom.parent, model, model.geom_bodyid[row])


def _put_surface(geom, model, row: int) -> None:
    geom.friction, geom.solref, geom.condim = model.geom_friction[row], model.geom_solref[row], model.geom_condim[row]


def _put_pair(pair, model, row: int) -> None:
    pair.friction, pair.solref, pair.condim = model.pair_friction[row], model.pair_solref[row], model.pair_dim[row]
    pair.margin = model.pair_margin[row]


def _same(model, row: int) -> int:
    return row


def _joint_of_dof(model, row: int) -> int:
    return int(model.dof_jntid[row])


def _joint_of_qpos(model, row: int) -> int:
    return int(np.flatnonzero(model.jnt_qposadr == row)[0])


DOF = ("dof_frictionloss", "dof_solref", "dof_solimp", "dof_damping", "dof_dampingpoly", "dof_armature")
DRIVE = tuple(f"actuator_{name}" for name in ("gainprm", "biasprm", "biastype", "forcerange", "forcelimited"))
INERTIAL = ("body_mass", "body_ipos", "body_inertia", "body_iquat")

# arrays of the model, elements of the spec, element of a row, writer
TABLE = (
    (DOF, "joints", _joint_of_dof, _put_dof),
    (("jnt_stiffness", "jnt_stiffnesspoly"), "joints", _same, _put_spring),
    (("qpos_spring",), "joints", _joint_of_qpos, _put_rest),
    (DRIVE, "actuators", _same, _put_actuator),
    (INERTIAL, "bodies", _same, _put_inertial),
    (("geom_pos", "geom_quat", "geom_size"), "geoms", _same, _put_shape),
    (("geom_friction", "geom_solref", "geom_condim"), "geoms", _same, _put_surface),
    (("pair_friction", "pair_solref", "pair_dim", "pair_margin"), "pairs", _same, _put_pair),
)
