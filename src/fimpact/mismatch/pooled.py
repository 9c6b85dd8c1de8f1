"""Pooled: training and held-out windows as one set, for questions that no parameter is fitted to answer."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Linear
from fimpact.mismatch.pulses import Pulses


def pooled(parts: Sequence[Fit], found: Pulses, held_out: Pulses) -> tuple[Fit, Pulses]:
    """One fit of the training windows and, after them, of those held out, and the pulses in all of them.

    Args:
        parts: the fits of both, of the same coordinates.
    """
    learned, shown = parts
    names = "basis", "triangle", "raw"
    basis, triangle, raw = (stacked(getattr(learned.linear, n), getattr(shown.linear, n)) for n in names)
    linear = Linear(basis, triangle, raw, raw)
    linear = replace(linear, projected=linear.off(raw))
    point = replace(learned.point, residual=stacked(learned.point.residual, shown.point.residual))
    return replace(learned, point=point, linear=linear, precision=_precision(learned, linear)), _joined(found, held_out)


def refitted(fitted: Fit) -> Fit:
    """`fitted` with the residual, (w, m), that is left once its coordinates are where all of its windows would have
    them: those of a fit that has learned from some were never asked by the others."""
    linear, point = fitted.linear, fitted.point
    slope = np.einsum("wma,wm->a", linear.projected, linear.off(point.residual)) - fitted.pull
    return replace(fitted, point=replace(point, residual=point.residual - linear.raw @ (fitted.covariance @ slope)))


def stacked(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Both along the first axis, the shorter along the second filled up with zeros."""
    longest = max(first.shape[1], second.shape[1])
    filled = [np.pad(a, [(0, 0), (0, longest - a.shape[1]), *[(0, 0)] * (a.ndim - 2)]) for a in (first, second)]
    return np.concatenate(filled)


def _precision(fitted: Fit, linear: Linear) -> np.ndarray:
    return np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(fitted.coordinates.sd**-2.0)


def _joined(found: Pulses, held_out: Pulses) -> Pulses:
    alike = "time", "qpos", "qvel", "ctrl", "mode", "swing"
    joined = {name: np.concatenate([getattr(found, name), getattr(held_out, name)]) for name in alike}
    columns, clocks = stacked(found.columns, held_out.columns), _apart(found.clocks, held_out.clocks)
    return replace(found, columns=columns, clocks=clocks, **joined)


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(w1, m, r1) and (w2, m, r2) as (w1 + w2, m, r1 + r2), each in columns of its own."""
    wide = np.pad(first, [(0, 0), (0, 0), (0, second.shape[2])]), np.pad(second, [(0, 0), (0, 0), (first.shape[2], 0)])
    return stacked(*wide)
