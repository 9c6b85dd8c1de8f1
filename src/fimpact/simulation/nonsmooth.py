"""What makes a motion non-smooth: contacts, limits, equalities and dry friction.

MuJoCo's dry friction is a stiff damper until it slips: with the default `solref` a joint starts to turn over 10 ms
before it stops. Friction that is added here is exact instead: its damper stops the joint within one step.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.native import STIFFEST
from fimpact.effects.touching import can_touch


def has_constraints(model: mujoco.MjModel) -> bool:
    """Whether anything in `model` may be held or rubbed: by contact, limits, equalities or dry friction."""
    limited = model.jnt_limited.any() or model.tendon_limited.any()
    rubbed = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    return bool(can_touch(model) or limited or model.neq or rubbed)


def make_friction_exact(model: mujoco.MjModel, base: mujoco.MjModel, placed: Sequence[Placed] = ()) -> list[int]:
    """Tighten the dry friction of joints that have more of it than in `base`; returns their degrees of freedom.

    Where there was some, what is added is exact and the old part stays as it was: the damping rate is the mean of
    both, so that nothing jumps where the first of it is added.

    Args:
        placed: laws of friction among them set it in each step, and count too where there was none.
    """
    own = base.dof_frictionloss
    added = np.maximum(model.dof_frictionloss - own, 0.0)
    for law in (p for p in placed if p.effect.enters == "friction"):
        dof = model.joint(law.site).dofadr[0]
        added[dof] = 1.0 if not own[dof] else added[dof]
    dofs = np.flatnonzero((added > 0) & (base.dof_solref[:, 0] > 0))
    for dof in dofs.tolist():
        _tighten(model, base, dof, added[dof] / (added[dof] + own[dof]))
    return dofs.tolist()


def stop_within_a_step(model: mujoco.MjModel) -> None:
    """Let all dry friction of joints stop them in one step."""
    rubbing = model.dof_frictionloss > 0
    model.dof_solref[rubbing] = 2 * model.opt.timestep, 1.0  # the tightest that MuJoCo keeps (refsafe)
    model.dof_solimp[rubbing, :2] = STIFFEST


def _tighten(model: mujoco.MjModel, base: mujoco.MjModel, dof: int, share: float) -> None:
    """Let `share` of the friction of `dof` stop it in one step: rate 2 / (time constant * impedance) = 1 / step."""
    (constant, ratio), impedance = base.dof_solref[dof], base.dof_solimp[dof, :2]
    rate = (1 - share) * 2 / (constant * impedance[1]) + share / model.opt.timestep
    model.dof_solimp[dof, :2] = mixed = (1 - share) * impedance + share * STIFFEST
    model.dof_solref[dof] = 2 / (rate * mixed[1]), (1 - share) * ratio + share
