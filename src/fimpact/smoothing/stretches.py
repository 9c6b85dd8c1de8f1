"""Stretches of a recording that tell something of their own: what is left of a model is no white noise."""

from typing import Protocol

import numpy as np

from fimpact.deciding import STRETCHES

LEAST = 8  # samples in a stretch
LONG = 4  # correlation times in a stretch


class Runs(Protocol):
    """Samples of some runs, one after the other: `count` of them, in these `slices`."""

    @property
    def count(self) -> int: ...

    def slices(self) -> list[slice]: ...


def stretches(track: Runs, tau: np.ndarray) -> np.ndarray:
    """Stretch of each sample, (N,): some correlation times of the missing force `tau` (N, nv), at least `STRETCHES` in
    all; of each run, its own."""
    lag = max((_correlation_time(tau[rows]) for rows in track.slices()), default=1)
    most, few = max(track.count // (2 * STRETCHES), LEAST), max(track.count // (4 * STRETCHES), LEAST)
    length = int(np.clip(LONG * lag, few, most))
    out, begun = np.empty(track.count, int), 0
    for rows in track.slices():
        size = rows.stop - rows.start
        parts = max(size // length, 1)
        out[rows] = begun + np.minimum(np.arange(size) * parts // size, parts - 1)
        begun += parts
    return out


def spread_of_scores(scores: np.ndarray, information: np.ndarray) -> float:
    """By how much scores (stretches, p) vary more than white noise of `information` (p,) would have it, at least 1."""
    spread = ((scores - scores.mean(0)) ** 2).sum(0)
    known = information > 0
    return max(1.0, float(np.median(spread[known] / information[known]))) if known.any() else 1.0


def _correlation_time(tau: np.ndarray) -> int:
    """Samples after which the autocorrelation of the loudest force has fallen to 1 / e."""
    own = tau[:, int(np.argmax((tau**2).mean(0)))]
    own = own - own.mean()
    if len(own) < LEAST or not own.any():
        return 1
    size = 2 * len(own)
    power = np.fft.irfft(np.abs(np.fft.rfft(own, size)) ** 2, size)[: len(own)]
    below = np.flatnonzero(power < power[0] / np.e)
    return int(below[0]) if len(below) else len(own)
