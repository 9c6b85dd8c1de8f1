"""What can touch what in a model."""

import mujoco
import numpy as np

NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
ROUND = (int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_CAPSULE))


def can_touch(model: mujoco.MjModel) -> bool:
    """Whether anything in it may come into contact."""
    if model.opt.disableflags & NO_CONTACT:
        return False
    return bool(model.npair or (model.geom_contype.any() and model.geom_conaffinity.any()))


def pairs_of(model: mujoco.MjModel, geom: int) -> list[int]:
    """Explicit contact pairs that contain `geom`."""
    return np.flatnonzero((model.pair_geom1 == geom) | (model.pair_geom2 == geom)).tolist()


def partners(model: mujoco.MjModel, geom: int) -> list[int]:
    """Geoms on other bodies that `geom` may touch by their types, one of the two moving; where an explicit pair lists
    both, it replaces that."""
    listed = [i for pair in pairs_of(model, geom) for i in (model.pair_geom1[pair], model.pair_geom2[pair])]
    meets = (model.geom_contype & model.geom_conaffinity[geom]) | (model.geom_conaffinity & model.geom_contype[geom])
    weld = model.body_weldid[model.geom_bodyid]
    return np.setdiff1d(np.flatnonzero((meets != 0) & (weld != weld[geom])), listed).tolist()


def round_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Spheres and capsules of `body` that can touch something."""
    if not can_touch(model):
        return []
    own = np.flatnonzero((model.geom_bodyid == body) & np.isin(model.geom_type, ROUND))
    return [i for i in map(int, own) if pairs_of(model, i) or partners(model, i)]
