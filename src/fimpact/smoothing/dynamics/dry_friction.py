"""Dry friction in a fit: a force at the expected sign of a speed that is known to some standard deviation only.

Exact friction has no derivative where it stops a joint, and a fit through its reversals never settles.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.laws import bounds_of, expected_sign, middle, slope_of_sign, speed_doubt
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.states import States

STEEP = 4.0  # times the slope that stops a joint within a sample: no tangent is steeper


@dataclass(frozen=True)
class Rubbing:
    """Dry friction along a trajectory, (N, nv) each: force, its slope by the speed half a sample later, and the sign of
    that speed."""

    force: np.ndarray
    slope: np.ndarray
    sign: np.ndarray


def rubbing(
    track: Track,
    model: mujoco.MjModel,
    dry: np.ndarray,
    laws: Sequence[Placed],
    states: States,
    tau: np.ndarray,
    doubt: np.ndarray,
    sign: np.ndarray | None = None,
) -> Rubbing:
    """Dry friction of a hypothesis along `states`.

    Args:
        dry: friction of the joints, (nv,). laws: those of dry friction. doubt: sd of the speeds, (N, nv). sign: known
            already, (N, nv), and then without a slope.
    """
    forward = np.tile(dry, (track.count, 1))
    backward = forward.copy()
    for law in laws:
        dof = int(track.model.joint(law.site).dofadr[0])
        ends = bounds_of(track, law, states, tau)
        forward[:, dof] += ends[0]
        backward[:, dof] += ends[1]
    slope = np.zeros_like(forward)
    if sign is None:
        speed, spread = middle(track, states)[1], speed_doubt(track, states, doubt)
        sign = expected_sign(speed, spread)
        # What stops a joint within a sample has no tangent beyond it: the midpoint rule would let it swing.
        steepest = STEEP / (model.dof_invweight0 * track.period)
        slope = np.maximum(-(forward + backward) / 2 * slope_of_sign(speed, spread), -steepest)
    return Rubbing(-(forward * (1 + sign) - backward * (1 - sign)) / 2, slope, sign)
