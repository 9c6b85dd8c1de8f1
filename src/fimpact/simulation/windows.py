"""Windows: the stretches of runs that are simulated, each from an initial state of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.recordings import Run

GOLDEN = 0.6180339887498949  # multiples of it are spread evenly between whole numbers


@dataclass(frozen=True)
class Windows:
    """Stretches of runs, padded to one length.

    runs: the run of each, first: its first sample, each (w,). measured: (w, T, ny), NaN where missing or after the end
    of the run. ctrl: every run's commands, (runs, N, nu), padded by their last row. names: of the runs.
    """

    runs: np.ndarray
    first: np.ndarray
    measured: np.ndarray
    ctrl: np.ndarray
    names: tuple[str, ...]

    @property
    def length(self) -> int:
        """Samples in a window, T."""
        return self.measured.shape[1]

    def begun(self, length: int) -> "Windows":
        """The first `length` samples of each."""
        return replace(self, measured=self.measured[:, :length])

    def part(self, rows: np.ndarray) -> "Windows":
        """Select windows by a mask (w,) or by indices, which may repeat."""
        return replace(self, runs=self.runs[rows], first=self.first[rows], measured=self.measured[rows])


def cut(runs: Sequence[Run], length: int, most: int = 0) -> Windows:
    """Cut runs into windows of `length` samples, 0: whole runs.

    A remainder shorter than half a window is left out, and so are, if there are others, windows without measurements.

    Args:
        most: how many are kept, spread evenly over all runs; 0: all.
    """
    longest = max(len(run.measured) for run in runs)
    size = min(length or longest, longest)
    places = [(i, k) for i, run in enumerate(runs) for k in range(0, max(len(run.measured) - size // 2, 1), size)]
    which, first = np.array([places[i] for i in spread(len(places), most)]).T
    measured = np.stack([_padded(runs[i].measured, k, size) for i, k in zip(which, first, strict=True)])
    ctrl = np.array([run.ctrl[np.minimum(np.arange(longest + size), len(run.ctrl) - 1)] for run in runs])
    seen = np.isfinite(measured).any((1, 2))
    kept = seen if seen.any() else ~seen
    return Windows(which[kept], first[kept], measured[kept], ctrl, tuple(run.name for run in runs))


def spread(count: int, most: int) -> np.ndarray:
    """Choose `most` of `count` indices, 0: all: one in each of as many equal stretches.

    Where in its stretch varies, or every run of a few windows would give the same one of them.
    """
    if not 0 < most < count:
        return np.arange(count)
    chosen = np.arange(most)
    return ((chosen + chosen * GOLDEN % 1.0) * count / most).astype(int)


def _padded(measured: np.ndarray, first: int, size: int) -> np.ndarray:
    out = np.full((size, measured.shape[1]), np.nan)
    piece = measured[first : first + size]
    out[: len(piece)] = piece
    return out
