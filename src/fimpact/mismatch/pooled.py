"""Pooled: training and held-out windows as one set, for questions that no parameter is fitted to answer."""

from dataclasses import replace

import numpy as np

from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.problem import Linear
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.weigh import both


def pooled(bench: Bench, explanation: Explanation, found: Pulses, held_out: Pulses) -> tuple[Fit, Pulses]:
    """The explanation's fit with all windows, training first, and the pulses in them."""
    learned, shown = both(bench, explanation)
    residual = stacked(learned.point.residual, shown.point.residual)
    names = "basis", "triangle", "raw"
    basis, triangle, raw = (stacked(getattr(learned.linear, n), getattr(shown.linear, n)) for n in names)
    linear = Linear(basis, triangle, raw, raw)
    linear = replace(linear, projected=linear.off(raw))
    point = replace(learned.point, residual=residual)
    return replace(learned, point=point, linear=linear, precision=_precision(learned, linear)), _pulses(found, held_out)


def stacked(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Both along the first axis, the shorter along the second filled up with zeros."""
    longest = max(first.shape[1], second.shape[1])
    filled = [np.pad(a, [(0, 0), (0, longest - a.shape[1]), *[(0, 0)] * (a.ndim - 2)]) for a in (first, second)]
    return np.concatenate(filled)


def _precision(fitted: Fit, linear: Linear) -> np.ndarray:
    return np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(fitted.coordinates.sd**-2.0)


def _pulses(found: Pulses, held_out: Pulses) -> Pulses:
    alike = "time", "qpos", "qvel", "ctrl", "mode", "swing"
    both = {name: np.concatenate([getattr(found, name), getattr(held_out, name)]) for name in alike}
    return replace(
        found, columns=stacked(found.columns, held_out.columns), clocks=_apart(found.clocks, held_out.clocks), **both
    )


def _apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(w1, m, r1) and (w2, m, r2) as (w1 + w2, m, r1 + r2), each in columns of its own."""
    wide = np.pad(first, [(0, 0), (0, 0), (0, second.shape[2])]), np.pad(second, [(0, 0), (0, 0), (first.shape[2], 0)])
    return stacked(*wide)
