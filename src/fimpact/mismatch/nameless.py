"""Nameless: is there a force that no effect of the catalogue gives, as a smooth curve over state, time or command?"""

import numpy as np

from fimpact.effects.base import Effect, Placed
from fimpact.mismatch.calibrate import adjusted_groups, background
from fimpact.mismatch.colour import coloured
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.pulses import Pulses, curves
from fimpact.mismatch.score import score

NAMELESS = Placed(
    Effect("nameless", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], np.zeros_like, {}),
    "",
    {},
)


def nameless(bench: Bench, fitted: Fit, found: Pulses) -> tuple[float, float]:
    """Family-wise p of a force without a name, any of the `curves`, beside what is fitted, and its predicted gain."""
    fitted, groups = coloured(fitted, found), {}
    for dof, regressor, curve in curves(found):
        candidate = score(bench.training, fitted, NAMELESS, found.along(dof, curve))
        if candidate.information > 0:
            groups.setdefault((dof, regressor), []).append(candidate.column.ravel())
    stacked = [np.stack(group, 1) for group in groups.values()]
    if not stacked:
        return 1.0, 0.0
    p, gain = adjusted_groups(stacked, fitted.linear.off(fitted.point.residual).ravel(), background(fitted, found))
    return float(p.min()), float(gain[np.argmin(p)])
