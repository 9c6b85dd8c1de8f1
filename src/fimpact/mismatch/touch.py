"""Whether a model has anything that touches, holds or rubs: then its motion has kinks, and needs a solver."""

from typing import TYPE_CHECKING

import mujoco

if TYPE_CHECKING:
    from fimpact.mismatch.simulate import Hypothesis

LOOSE = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT)  # what has impacts


def can_touch(model: mujoco.MjModel) -> bool:
    """Whether anything in it may come into contact."""
    return bool(model.npair or (model.geom_contype.any() and model.geom_conaffinity.any()))


def can_bump(model: mujoco.MjModel) -> bool:
    """Whether anything in it may come into contact or to a limit."""
    return bool(can_touch(model) or model.jnt_limited.any() or model.tendon_limited.any())


def can_hold(model: mujoco.MjModel) -> bool:
    """Whether anything in it may be held or rubbed: by contact, limits, equalities or dry friction."""
    rubbed = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    return bool(can_bump(model) or model.neq or rubbed)


def may_stick(model: mujoco.MjModel, hypothesis: "Hypothesis") -> bool:
    """Whether anything in it may be held or rubbed under `hypothesis`, whose effects may be dry friction."""
    dry = (p.effect.enters == "friction" or "coulomb" in (p.effect.name, *p.effect.contains) for p in hypothesis.placed)
    return can_hold(model) or any(dry)
