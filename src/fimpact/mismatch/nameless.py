"""Nameless: is there a force, or an error of a sensor, that no effect of the catalogue gives, as a smooth curve over
state, time, command or reading?"""

import numpy as np

from fimpact.effects.base import Effect, Placed
from fimpact.mismatch.calibrate import adjusted_groups, background
from fimpact.mismatch.colour import coloured
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import Pulses, bumps, curves
from fimpact.mismatch.score import score

NAMELESS = Placed(
    Effect("nameless", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], np.zeros_like, {}),
    "",
    {},
)


def nameless(bench: Bench, fitted: Fit, found: Pulses) -> tuple[float, float]:
    """Family-wise p of what has no name, any of the `curves` and `readings`, beside what is fitted, and its predicted
    gain."""
    fitted, groups = coloured(fitted, found), {}
    forces = ((dof, regressor, found.along(dof, curve)) for dof, regressor, curve in curves(found))
    for dof, regressor, column in (*forces, *readings(bench.training, fitted)):
        candidate = score(bench.training, fitted, NAMELESS, column)
        if candidate.information > 0:
            groups.setdefault((dof, regressor), []).append(candidate.column.ravel())
    stacked = [np.stack(group, 1) for group in groups.values()]
    if not stacked:
        return 1.0, 0.0
    p, gain = adjusted_groups(stacked, fitted.linear.off(fitted.point.residual).ravel(), background(fitted, found))
    return float(p.min()), float(gain[np.argmin(p)])


def readings(problem: Problem, fitted: Fit) -> list[tuple[int, str, np.ndarray]]:
    """(channel, "reading", sensitivity (w, m)) of errors of each channel that are smooth bumps over its range."""
    point, out = fitted.point, []
    # Not over what was measured, which its own noise would be found in.
    predicted = problem.simulator.predict(point.hypothesis, problem.windows, point.qpos, point.qvel)
    for channel in range(predicted.shape[2]):
        for bump in bumps(predicted[:, :, channel]):
            error = np.zeros_like(predicted)
            error[:, :, channel] = bump
            out.append((channel, "reading", problem.extend(problem.whiten(error)[..., None])[..., 0]))
    return out
