"""Nameless: is there a force, or an error of a sensor, that no effect of the catalogue gives, as a smooth curve over
state, time, command or reading; or an effect that is there, but not alike in all runs?"""

from collections.abc import Sequence

import numpy as np
from scipy.linalg import null_space

from fimpact.effects.base import Effect, Placed
from fimpact.mismatch.calibrate import adjusted_groups, background
from fimpact.mismatch.colour import coloured
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import Pulses, bumps, curves
from fimpact.mismatch.score import Candidate, rescore, score

NAMELESS = Placed(
    Effect("nameless", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], np.zeros_like, {}),
    "",
    {},
)


def nameless(bench: Bench, fitted: Fit, found: Pulses, candidates: Sequence[Candidate]) -> tuple[float, float]:
    """Family-wise p of what has no name, any of the `curves` and `readings` and whatever varies among the `candidates`,
    beside what is fitted, and its predicted gain."""
    fitted, groups = coloured(fitted, found), {}
    forces = ((dof, regressor, found.along(dof, curve)) for dof, regressor, curve in curves(found))
    for dof, regressor, column in (*forces, *readings(bench.training, fitted)):
        candidate = score(fitted, NAMELESS, column)
        if candidate.information > 0:
            groups.setdefault((dof, regressor), []).append(candidate.column.ravel())
    stacked = [np.stack(group, 1) for group in groups.values()] + varying(bench.training, fitted, candidates)
    if not stacked:
        return 1.0, 0.0
    p, gain = adjusted_groups(stacked, fitted.linear.off(fitted.point.residual).ravel(), background(fitted, found))
    return float(p.min()), float(gain[np.argmin(p)])


def varying(problem: Problem, fitted: Fit, candidates: Sequence[Candidate]) -> list[np.ndarray]:
    """Sensitivities, (w m, runs - 1), to the differences of each effect between runs: what is alike in all is none."""
    best: dict[str, Candidate] = {}
    for candidate in sorted(rescore(fitted, candidates), key=lambda c: -c.gain):
        best.setdefault(candidate.placed.name, candidate)
    apart = (differences(candidate.column, problem.windows.runs) for candidate in best.values())
    return [columns for columns in apart if columns.shape[1]]


def differences(column: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Columns (w m, runs - 1), across `column` (w, m), that it is made of when each of its `runs`, (w,), has a strength
    of its own."""
    shown = [run for run in np.unique(runs) if np.any(column[runs == run])]
    apart = np.stack([np.where(runs[:, None] == run, column, 0.0).ravel() for run in shown], 1)
    size = np.linalg.norm(apart, axis=0)
    return apart / size @ null_space(size[None])


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
