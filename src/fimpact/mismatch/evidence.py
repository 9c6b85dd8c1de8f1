"""Evidence: what an explanation is worth on runs that it was not fitted to; the choice among names saw them.

Errors are root mean squares in standard deviations of the noise, initial states profiled alike for every model, so
that 1 is as good as anything can be. Whole runs are held out, never windows of a training run.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, freedom

RESAMPLES = 2000
LAGS = 5  # samples over which a residual must not remember itself
WHITE = 0.1  # autocorrelation up to which intervals are stated as they are


@dataclass(frozen=True)
class Evidence:
    """Held-out error before and after, the noise floor, the improvement (1 - after / before) with a 95 % interval over
    resampled runs and windows, widened where they are few, the share of the explainable mismatch explained, residual
    autocorrelation before and after, and errors by run and by channel (in the channel's unit)."""

    before: float
    after: float
    noise_floor: float
    improvement: float
    low: float
    high: float
    explained: float
    memory_before: float
    memory_after: float
    by_run: dict[str, tuple[float, float]]
    by_channel: dict[str, tuple[float, float]]

    @property
    def white(self) -> bool:
        """Whether what is left looks like noise."""
        return abs(self.memory_after) < WHITE


def weigh_evidence(bench: Bench, naive: Explanation, best: Explanation) -> Evidence:
    """Compare two explanations on the held-out windows of `bench`."""
    problem = bench.held_out
    samples = np.isfinite(problem.windows.measured).sum((1, 2))
    floor = np.sqrt(max(freedom(problem), 0.0) / samples.sum())
    before, after = naive.judged.point.squares, best.judged.point.squares
    apart = float(((naive.judged.point.residual - best.judged.point.residual) ** 2).sum())
    low, high = _interval(problem.windows.runs, samples, before, after, apart)
    whole = before.sum() - freedom(problem)
    return Evidence(
        before=_rms(before, samples),
        after=_rms(after, samples),
        noise_floor=float(floor),
        improvement=1 - _rms(after, samples) / _rms(before, samples),
        low=low,
        high=high,
        explained=float(np.clip((before.sum() - after.sum()) / whole, 0.0, 1.0)) if whole > 0 else 0.0,
        memory_before=memory(bench, naive.judged),
        memory_after=memory(bench, best.judged),
        by_run={
            name: (_rms(before[at], samples[at]), _rms(after[at], samples[at]))
            for i, name in enumerate(problem.windows.names)
            if (at := problem.windows.runs == i).any()
        },
        by_channel=_by_channel(bench, naive.judged, best.judged),
    )


def _rms(squares: np.ndarray, samples: np.ndarray) -> float:
    return float(np.sqrt(squares.sum() / max(samples.sum(), 1)))


def _interval(runs, samples, before, after, apart: float) -> tuple[float, float]:
    """95 % interval of the improvement: windows resampled within resampled runs, and no narrower than `_of_few`."""
    rng, found = np.random.default_rng(0), []
    groups = [np.flatnonzero(runs == i) for i in np.unique(runs)]
    for _ in range(RESAMPLES):
        chosen = [groups[i] for i in rng.integers(len(groups), size=len(groups))]
        rows = np.concatenate([rng.choice(group, len(group)) for group in chosen])
        found.append(1 - np.sqrt(after[rows].sum() / before[rows].sum()))
    low, high = np.percentile(found, [2.5, 97.5])
    least, most = _of_few(samples, before, after, apart)
    return float(min(low, least)), float(max(high, most))


def _of_few(samples, before, after, apart: float) -> tuple[float, float]:
    """The same by Student's t of windows, which says how little a few of them know; of a single one by the noise that
    it has, as loud as what is left: squares `apart` of the two models times noise is what chance makes of them."""
    n, ratio = len(before), after.sum() / before.sum()
    if n > 1:
        half = student.ppf(0.975, n - 1) * np.std(after - ratio * before, ddof=1) * np.sqrt(n) / before.sum()
    else:
        half = norm.ppf(0.975) * 2 * np.sqrt(apart * max(after[0] / samples[0], 1.0)) / before.sum()
    return 1 - np.sqrt(ratio + half), 1 - np.sqrt(max(ratio - half, 0.0))


def residuals(bench: Bench, judged: Fit) -> np.ndarray:
    """Whitened residuals of the held-out windows, (w, T, ny)."""
    shape = bench.held_out.windows.measured.shape
    return judged.point.residual[:, : shape[1] * shape[2]].reshape(shape)


def memory(bench: Bench, judged: Fit) -> float:
    """Largest mean autocorrelation of a channel's held-out residual over the first lags, in samples of its own; 0 is
    white."""
    error, seen = residuals(bench, judged), np.isfinite(bench.held_out.windows.measured)
    both = product(range(error.shape[2]), range(1, LAGS + 1))
    return max((_correlation(error[..., i], seen[..., i], lag) for i, lag in both), key=abs)


def _correlation(error: np.ndarray, seen: np.ndarray, lag: int) -> float:
    own = [row[known] for row, known in zip(error, seen, strict=True)]
    products = np.concatenate([series[lag:] * series[:-lag] for series in own])
    power = np.mean(error[seen] ** 2) if seen.any() else 0.0
    return float(products.mean() / power) if products.size and power else 0.0


def _by_channel(bench: Bench, before: Fit, after: Fit) -> dict[str, tuple[float, float]]:
    problem = bench.held_out
    seen = np.isfinite(problem.windows.measured)
    out = {}
    for i, channel in enumerate(problem.simulator.recording.channels):
        error = [(residuals(bench, fit) * problem.noise)[..., i][seen[..., i]] for fit in (before, after)]
        out[channel] = tuple(float(np.sqrt(np.mean(e**2))) for e in error)
    return out
