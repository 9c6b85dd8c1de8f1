"""Windows: the short stretches of runs that are simulated, each from an initial state of its own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.effects.base import TURNED
from fimpact.recordings import Run

GOLDEN = 0.6180339887498949  # multiples of it are spread evenly between whole numbers


@dataclass(frozen=True)
class Windows:
    """Stretches of runs, padded to one length: measured (w, T, ny), NaN where missing; runs: the run of each, first:
    its first sample, each (w,); ctrl: every run's commands, (runs, N, nu), padded by their last row; ends: samples in
    each run, (runs,), None: as many as rows of commands; turned: where joints have turned before, (w, k, nv) of
    `turned.turns`, None: not known."""

    runs: np.ndarray
    first: np.ndarray
    measured: np.ndarray
    ctrl: np.ndarray
    names: tuple[str, ...]
    ends: np.ndarray | None = None
    turned: np.ndarray | None = None

    @property
    def length(self) -> int:
        """Samples in a window, T."""
        return self.measured.shape[1]

    @property
    def left(self) -> np.ndarray:
        """Samples of its run that come after each window, (w,)."""
        ends = np.full(len(self.ctrl), self.ctrl.shape[1]) if self.ends is None else self.ends
        return np.maximum(ends[self.runs] - self.first - self.length, 0)

    def part(self, rows: np.ndarray) -> "Windows":
        """Some of them only: `rows`, a mask (w,) or indices."""
        turned = None if self.turned is None else self.turned[rows]
        return replace(self, runs=self.runs[rows], first=self.first[rows], measured=self.measured[rows], turned=turned)

    @property
    def memory(self) -> dict[str, np.ndarray]:
        """What laws remember where the windows begin."""
        return {} if self.turned is None else {TURNED: self.turned}


def cut(runs: Sequence[Run], length: int, most: int = 0) -> Windows:
    """Windows of `length` samples, 0: whole runs; left out are a remainder shorter than half a window and, if there are
    others, windows without any measurement.

    Args:
        most: how many are kept, spread evenly over all runs; 0: all.
    """
    longest = max(len(run.measured) for run in runs)
    size = min(length or longest, longest)
    places = [(i, k) for i, run in enumerate(runs) for k in range(0, max(len(run.measured) - size // 2, 1), size)]
    places = [places[i] for i in spread(len(places), most)]
    index = np.arange(size)
    measured = np.full((len(places), size, runs[0].measured.shape[1]), np.nan)
    for row, (i, first) in enumerate(places):
        piece = runs[i].measured[first : first + size]
        measured[row, : len(piece)] = piece
    ctrl = np.array([run.ctrl[np.minimum(np.arange(longest + len(index)), len(run.ctrl) - 1)] for run in runs])
    which, first = np.array(places).T
    seen = np.isfinite(measured).any((1, 2))
    kept = seen if seen.any() else ~seen
    names, ends = tuple(run.name for run in runs), np.array([len(run.measured) for run in runs])
    return Windows(which[kept], first[kept], measured[kept], ctrl, names, ends)


def spread(count: int, most: int) -> np.ndarray:
    """Indices of `most` of `count` things, 0: of all: one in each of as many equal stretches. Where in its stretch
    varies, or every run of a few windows would give the same one of them."""
    if not 0 < most < count:
        return np.arange(count)
    chosen = np.arange(most)
    return ((chosen + chosen * GOLDEN % 1.0) * count / most).astype(int)
