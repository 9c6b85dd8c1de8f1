"""Proof by forward simulation: errors of what is predicted over horizons from 0.1 s to whole runs.

Every model is treated alike: windows start at a given estimate of the state, which is refined for each window and each
model on the window's own measurements by a few Gauss-Newton steps, within what is known of the start: a model that is
wrong would else buy a better fit with a start that nobody has seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fimpact.recordings import Recording, Run
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import DIVERGED, Simulator
from fimpact.simulation.window_fit import Fit, Starts, fit_windows, states_of, window_starts
from fimpact.simulation.windows import Windows, cut

MOST_WINDOWS = 20  # of each horizon, spread over all runs


@dataclass(frozen=True)
class HorizonErrors:
    """Root mean square errors by horizon, (h,) in s, and run: error (h, runs, ny) in the channels' units, normalised
    (h, runs) over channels in sd of noise. Infinite where a simulation diverged, NaN where a run has no window."""

    horizons: np.ndarray
    error: np.ndarray
    normalised: np.ndarray


def windows_of(recording: Recording, runs: Sequence[Run], horizons: Sequence[float]) -> list[Windows]:
    """Cut windows of `runs` for each of the horizons, s, at most `MOST_WINDOWS` of each."""
    longest = max(len(run.measured) for run in runs)
    return [cut(runs, min(max(round(h / recording.period), 2), longest), MOST_WINDOWS) for h in horizons]


def errors_of(fits: Sequence[Fit], period: float) -> HorizonErrors:
    """Gather errors of fits of several horizons, sampled every `period`, s."""
    error, normalised = (np.array(part) for part in zip(*map(_by_run, fits), strict=True))
    return HorizonErrors(np.array([fit.windows.length for fit in fits]) * period, error, normalised)


def predict_windows(
    simulator: Simulator, hypothesis: Hypothesis, windows: Windows, starts: Sequence[Starts], noise: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Predict `windows`, (w, T, ny), from starts that are refined on them; also those: qpos, qvel and act."""
    fit = fit_windows(simulator, hypothesis, windows, window_starts(windows, starts), noise)
    return fit.predicted, states_of(fit, simulator)


@DIVERGED
def _by_run(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square errors of each run by channel, (runs, ny), and over all of them in sd of noise, (runs,)."""
    windows = fit.windows
    squares = (windows.measured - fit.predicted) ** 2
    seen = np.isfinite(windows.measured)
    squares = np.where(seen, np.nan_to_num(squares, nan=np.inf), 0.0)
    each = [windows.runs == run for run in range(len(windows.names))]
    count = np.array([seen[rows].sum((0, 1)) for rows in each], float)
    total = np.array([squares[rows].sum((0, 1)) for rows in each])
    with np.errstate(divide="ignore"):
        return np.sqrt(total / count), np.sqrt((total / fit.noise**2).sum(1) / count.sum(1))
