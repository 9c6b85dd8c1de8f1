"""The filter of `kalman` over all runs of a track, on all threads."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fimpact.simulation.simulator import threads
from fimpact.smoothing.dynamics.linear import Linear
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.filter import kalman
from fimpact.smoothing.noise_levels import Levels


@dataclass(frozen=True)
class Filtered:
    """Gains (N, ny, m), innovation sd (N, ny) and factors of the states' covariance before their readings (N, n, n)."""

    gains: np.ndarray
    sd: np.ndarray
    before: np.ndarray

    def adjoint(self, track: Track, linear: Linear, innovations: np.ndarray) -> list[np.ndarray]:
        """`kalman.adjoint` of innovations (N, ny, c)."""
        parts = linear.advance, linear.reads, self.gains, self.sd, innovations
        return _over_runs(track, lambda bounds, rows, _: kalman.adjoint(bounds, *(part[rows] for part in parts)))


def filtered(track: Track, linear: Linear, levels: Levels) -> Filtered:
    """Filter the covariance of every run at the given noise levels."""
    noise = np.where(np.isfinite(track.measured), levels.reading * levels.louder, np.inf)
    parts = linear.advance, linear.reads, noise, levels.forces
    start = np.array([np.diag(spread) for spread in linear.spread])
    return Filtered(
        *_over_runs(
            track,
            lambda bounds, rows, runs: kalman.covariances(bounds, *(part[rows] for part in parts), start[runs]),
        )
    )


def swept(track: Track, linear: Linear, own: Filtered, pulls: np.ndarray) -> list[np.ndarray]:
    """Innovations (N, ny, c) in sd and means (N, m, c) of columns, the first ones those of `linear`.

    Args:
        pulls: mean of the missing force, (N, nv, c).
    """
    first = np.zeros((len(track.lengths), linear.first.shape[1], pulls.shape[2]))
    first[:, :, 0] = linear.first
    parts = linear.advance, linear.reads, own.gains, own.sd

    def work(bounds, rows, runs):
        ends = linear.offsets[rows], linear.left[rows], pulls[rows]
        return kalman.means(bounds, *(part[rows] for part in parts), first[runs], *map(np.ascontiguousarray, ends))

    return _over_runs(track, work)


def variances(track: Track, linear: Linear, own: Filtered) -> list[np.ndarray]:
    """`kalman.adjoint_variances` of every run."""
    parts = linear.advance, linear.reads, own.gains, own.sd
    return _over_runs(track, lambda bounds, rows, _: kalman.adjoint_variances(bounds, *(part[rows] for part in parts)))


def _over_runs(track: Track, work: Callable) -> list[np.ndarray]:
    """Rows (N, ...) of what `work` makes of the bounds of some runs, their rows and their numbers."""
    cuts = np.unique(np.searchsorted(track.bounds, np.linspace(0, track.bounds[-1], threads() + 1)))
    asked = []
    for first, last in pairwise(cuts):  # about as many samples each
        bounds = track.bounds[first : last + 1]
        asked.append((bounds - bounds[0], slice(bounds[0], bounds[-1]), slice(first, last)))
    if len(asked) == 1:
        return list(work(*asked[0]))
    with ThreadPoolExecutor(len(asked)) as pool:
        found = list(pool.map(work, *zip(*asked, strict=True)))
    return [np.concatenate(parts) for parts in zip(*found, strict=True)]
