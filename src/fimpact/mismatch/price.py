"""Price: what the coefficients of effects cost, whatever they explain.

The first amplitude of an effect costs log(samples), as in Schwarz's criterion. A further one of the same unit, and
a shape, cost what the marginal likelihood takes for them (Laplace's approximation; MacKay, Neural Computation 4(3),
1992): log(1 + (width / sd)^2) under a normal prior as wide as the effect is large, or as its probes go. What data
hardly know costs next to nothing: that friction is alike in both directions is not cheaper to say than that nobody
knows.
"""

from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import null_space

if TYPE_CHECKING:
    from fimpact.effects.base import Placed
    from fimpact.mismatch.fit import Fit

UNSEEN = 1e-5  # of the sensitivity to another coefficient: rounding
STATED = 4.0  # price of a shape that was stated before and is not fitted now


def price(fits: tuple["Fit", ...], covariance: np.ndarray | None = None) -> tuple[float, float]:
    """What the amplitudes and what the shapes of the effects placed cost, in squares; nothing for what changes nothing
    at all, as a shift out of the plane of a planar mechanism.

    Args:
        fits: of all sets of windows, the first one's coordinates fitted. covariance: of those, (k, k); None: as fitted.
    """
    fitted, most = fits[0], schwarz(fits)
    covariance = fitted.covariance if covariance is None else covariance
    row = {value: fitted.coordinates.unknowns + i for i, value in enumerate(fitted.coordinates.values)}
    shown, amplitudes, shapes = iter(seen(fitted)), 0.0, 0.0
    for i, placed in enumerate(fitted.point.hypothesis.placed):
        counted = [c for c in placed.effect.coefficients if next(shown)]
        for unit in dict.fromkeys(c.unit for c in counted if not c.shape):
            rows = [row.get((i, c.name)) for c in counted if c.unit == unit and not c.shape]
            values = np.array([placed.values[c.name] for c in counted if c.unit == unit and not c.shape])
            amplitudes += most + _further(values, rows, covariance, most)
        names = [c.name for c in counted if c.shape]
        free = [name for name in names if (i, name) in row]
        shapes += STATED * (len(names) - len(free))
        widths = np.array([max(abs(placed.values[name]), placed.sizes.get(name, 0.0)) for name in free])
        shapes += _volume(widths, _block(covariance, [row[i, name] for name in free]), most)
    return amplitudes, shapes


def schwarz(fits: tuple["Fit", ...]) -> float:
    """log(samples): what a coefficient costs that the data have chosen."""
    return float(np.log(sum((fit.point.residual != 0).sum() for fit in fits)))


def seen(fitted: "Fit") -> np.ndarray:
    """Whether each coefficient of the effects, (c,), changes anything, compared with others of its effect and unit;
    what is not fitted counts as seen, unless no probe moves it."""
    sizes = np.sqrt((fitted.linear.projected**2).sum((0, 1)))[fitted.coordinates.unknowns :]
    size = dict(zip(fitted.coordinates.values, sizes, strict=True))
    placed: tuple[Placed, ...] = fitted.point.hypothesis.placed
    coefficients = [(i, c) for i, p in enumerate(placed) for c in p.effect.coefficients]
    largest: dict[tuple[int, str], float] = {}
    for i, c in coefficients:
        largest[i, c.unit] = max(size.get((i, c.name), 0.0), largest.get((i, c.unit), 0.0))
    shown = [size.get((i, c.name), np.inf) > UNSEEN * largest[i, c.unit] for i, c in coefficients]
    return np.array([s and c.name not in placed[i].held for s, (i, c) in zip(shown, coefficients, strict=True)], bool)


def _further(values: np.ndarray, rows: list, covariance: np.ndarray, most: float) -> float:
    """Price of the amplitudes across the direction in which `values` point."""
    if len(rows) < 2 or None in rows:
        return most * (len(rows) - 1)
    size = float(np.linalg.norm(values))
    across = null_space(values[None] / size) if size > 0 else np.eye(len(rows))[:, 1:]
    return _volume(np.full(len(rows) - 1, size), across.T @ _block(covariance, rows) @ across, most)


def _volume(widths: np.ndarray, covariance: np.ndarray, most: float) -> float:
    """log of the prior's volume over the posterior's, squared; no more than Schwarz's price of as many. A variance of
    zero is that of a number which does nothing."""
    does = np.diag(covariance) > 0
    widths, covariance = widths[does], covariance[np.ix_(does, does)]
    spread = np.outer(widths, widths) * np.eye(len(widths))
    known, both = np.linalg.slogdet(covariance)[1], np.linalg.slogdet(covariance + spread)[1]
    return float(np.clip(both - known, 0.0, most * len(widths)))


def _block(covariance: np.ndarray, rows: list[int]) -> np.ndarray:
    return covariance[np.ix_(rows, rows)]
