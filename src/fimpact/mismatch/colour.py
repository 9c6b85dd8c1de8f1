"""The colour of what disturbs a robot: forces that nobody commands and that differ from window to window.

A draught, a cable, a warm motor push for longer than a sample. Such a force is taken for a random one that forgets
itself exponentially (Ornstein-Uhlenbeck), one size for each degree of freedom and one memory, both at their restricted
likelihood's maximum. Through the sensitivities to forces that gives the covariance of the residual, I + P K P'. Its
size is read from the residual itself, so a missing effect counts as noise here at first: that costs power and never
honesty.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

from fimpact.mismatch.bounded import bounded
from fimpact.mismatch.fit import Fit, inverse
from fimpact.mismatch.problem import Linear
from fimpact.mismatch.pulses import BINS, Pulses

CLOCK = 0.02  # of the sampling period: sd of a run's clock against that of its commands
FEW = 8  # windows
SIZES = (-9.0, 20.0)  # log of the variance, in units of what the sensors show of it
REWEIGHTED = 4  # passes; the first counts all windows alike
TRUST = 0.5  # of a coordinate's size: how far one linear step may go
PASSES = 3  # of a disturbance and the effect beside it in turn
MEMORIES = (-1.0, 3.5)  # log of the memory, in bins


@dataclass(frozen=True)
class Disturbance:
    """Standard deviation of the random force on each degree of freedom, (nv,), N or N m, and its memory in bins.

    noise: by which what is white beside it is louder than the sensors, at least 1: a fine encoder sees each roller of
    a bearing, which no eighth of a window holds.
    """

    sd: np.ndarray
    memory: float
    noise: float = 1.0

    def root(self) -> np.ndarray:
        """Cholesky factor of the covariance of the pulses, (nv * BINS, nv * BINS)."""
        return np.kron(np.diag(self.sd), _remembers(self.memory))


@dataclass(frozen=True)
class Colour:
    """Orthonormal directions (w, m, c) in which the residual of a window is louder than noise by sd `louder`, (w, c),
    what a late clock of each run does to it, (w, m, runs), and the disturbance that makes it so."""

    directions: np.ndarray
    louder: np.ndarray
    clocks: np.ndarray
    pushing: Disturbance

    @property
    def noise(self) -> float:
        """What is white, in units of the noise of the sensors."""
        return self.pushing.noise

    def white(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, m, k), in units in which the residual is white."""
        along = self.directions.transpose(0, 2, 1) @ columns
        return (columns - self.directions @ (along * (1 - 1 / self.louder)[:, :, None])) / self.noise

    def apply(self, linear: Linear) -> Linear:
        """`linear`, which knows no colour, in those units, the clocks after its own columns."""
        raw = np.concatenate([linear.raw, self.clocks], 2)
        basis, triangle = np.linalg.qr(self.white(linear.basis @ linear.triangle))
        new = Linear(basis, triangle, raw, raw, self)
        return replace(new, projected=new.off(raw))

    def with_clocks(self, own: np.ndarray, clock: float) -> np.ndarray:
        """A value of each coordinate, (k,), and `clock` for each clock."""
        return np.append(own, np.full(self.clocks.shape[2], clock))


def disturbance(fitted: Fit, found: Pulses) -> Disturbance:
    """The disturbance under which the residual of `fitted` is most likely; none where windows are too few to tell a
    force that differs from window to window from one that does not."""
    free, left = fitted.linear.off(found.columns), fitted.linear.off(fitted.point.residual)
    gram, along = free.transpose(0, 2, 1) @ free, np.einsum("wmb,wm->wb", free, left)
    seen = gram.diagonal(0, 1, 2).mean(0).reshape(-1, BINS).mean(1)
    unit, nv = 1 / np.sqrt(np.maximum(seen, 1e-300)), len(seen)
    if len(left) < FEW:
        return Disturbance(np.zeros(nv), 1.0)
    energy, count = (left**2).sum(), _freedom(fitted)

    def read(z):
        return Disturbance(np.exp(z[:nv] / 2) * unit, float(np.exp(z[nv])))

    def unlikely(z):
        # Sizes are in units of the white part, whose own is then known: the residual's, less what forces take.
        volume, taken, *slopes = _pushed(read(z), gram, along)
        white = max((energy - taken) / count, 1.0)
        return volume + (energy - taken) / white + count * np.log(white), slopes[0] - slopes[1] / white

    bounds = [SIZES] * nv + [MEMORIES]
    z = minimize(unlikely, np.append(np.zeros(nv), 1.0), jac=True, method="L-BFGS-B", bounds=bounds).x
    noise, best = float(np.sqrt(max((energy - _pushed(read(z), gram, along)[1]) / count, 1.0))), read(z)
    return Disturbance(best.sd * noise, best.memory, noise)


def _pushed(pushing: Disturbance, gram: np.ndarray, along: np.ndarray) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Log of the volume that `pushing` gives the residual, the squares that it takes of it, and how both change with
    the log of the variance on each degree of freedom and of the memory, (nv + 1,) each.

    Args:
        gram: of the sensitivities to pulses, (w, nv BINS, nv BINS). along: the residual's share of them, (w, nv BINS).
    """
    root, nv = pushing.root(), len(pushing.sd)
    inner = np.linalg.inv(np.eye(len(root)) + root.T @ gram @ root)
    shown = along @ root
    kept = (inner @ shown[..., None])[..., 0]
    # Of each degree of freedom by itself: forces on several know nothing of one another.
    used = len(gram) * np.eye(BINS) - _own(inner.sum(0), nv)
    took = _own(kept.T @ kept, nv)
    apart = np.abs(np.subtract.outer(np.arange(BINS), np.arange(BINS))) / pushing.memory
    whole = np.linalg.inv(_remembers(pushing.memory))
    longer = whole @ (np.exp(-apart) * apart) @ whole.T
    slopes = [np.append(np.trace(own, axis1=1, axis2=2), (own * longer).sum()) for own in (used, took)]
    return -np.linalg.slogdet(inner)[1].sum(), float((shown * kept).sum()), *slopes


def _remembers(memory: float) -> np.ndarray:
    """Cholesky factor of the correlation of bins, (BINS, BINS)."""
    apart = np.abs(np.subtract.outer(np.arange(BINS), np.arange(BINS)))
    return np.linalg.cholesky(np.exp(-apart / memory) + 1e-9 * np.eye(BINS))


def _own(both: np.ndarray, count: int) -> np.ndarray:
    """The `count` blocks on the diagonal of (count BINS, count BINS), (count, BINS, BINS)."""
    each = np.arange(count)
    return both.reshape(count, BINS, count, BINS)[each, :, each]


def _freedom(fitted: Fit) -> float:
    samples = int((fitted.point.residual != 0).sum())
    return max(samples - np.prod(fitted.linear.basis.shape[::2]) - fitted.linear.raw.shape[2], 1.0)


def colour(found: Pulses, pushing: Disturbance) -> Colour:
    """What `pushing` makes of the noise in the windows of `found`."""
    directions, size, _ = np.linalg.svd(found.columns @ pushing.root(), full_matrices=False)
    return Colour(directions, np.sqrt(1 + (size / pushing.noise) ** 2), found.clocks, pushing)


def beside(fitted: Fit, found: Pulses, change: np.ndarray) -> Disturbance:
    """The disturbance left by `fitted` and as much of a candidate as suits it best, which does `change`, (w, m): beside
    `fitted` alone a missing effect passes for a disturbance, in which it hides."""
    pushing = disturbance(fitted, found)
    for _ in range(PASSES):
        point = replace(fitted.point, residual=_without(fitted, colour(found, pushing), change))
        pushing = disturbance(replace(fitted, point=point), found)
    return pushing


def _without(fitted: Fit, shade: Colour, change: np.ndarray) -> np.ndarray:
    """Residual, (w, m), one generalised step away, `change` among the coordinates."""
    linear, plain = shade.apply(fitted.linear), np.concatenate([fitted.linear.raw, shade.clocks, change[..., None]], 2)
    columns = linear.off(plain)
    prior = np.append(shade.with_clocks(fitted.coordinates.sd, CLOCK), np.inf)
    scale = np.append(shade.with_clocks(fitted.scale, CLOCK), 1 / np.sqrt(max((columns[..., -1] ** 2).sum(), 1e-300)))
    hessian = np.einsum("wma,wmb->ab", columns, columns) + np.diag(prior**-2.0)
    slope = np.einsum("wma,wm->a", columns, linear.off(fitted.point.residual))
    slope -= np.append(shade.with_clocks(fitted.pull, 0.0), 0.0)
    step = scale * np.linalg.lstsq(hessian * np.outer(scale, scale), slope * scale, rcond=1e-12)[0]
    return fitted.point.residual - plain @ step


def coloured(fitted: Fit, found: Pulses, pushing: Disturbance | None = None) -> Fit:
    """`fitted` with its problem in units in which disturbances, `pushing` or those that it leaves, are white noise, and
    with a clock of its own for each run as further coordinates."""
    shade = colour(found, pushing or disturbance(fitted, found))
    linear, prior = shade.apply(fitted.linear), shade.with_clocks(fitted.coordinates.sd, CLOCK)
    precision = np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(prior**-2.0)
    scale, pull = shade.with_clocks(fitted.scale, CLOCK), shade.with_clocks(fitted.pull, 0.0)
    return replace(fitted, linear=linear, precision=precision, scale=scale, pull=pull)


@dataclass(frozen=True)
class Generalised:
    """The generalised least-squares optimum one linear step away: squares and samples of each window, (w,) for each set
    of windows, the step and the information on the coordinates, clocks not known, (k,) and (k, k), their scale, and how
    far it bends what was known of coordinates and clocks before, in squares."""

    squares: list[np.ndarray]
    samples: list[np.ndarray]
    step: np.ndarray
    information: np.ndarray
    scale: np.ndarray
    bent: float

    @property
    def covariance(self) -> np.ndarray:
        """Of the coordinates, (k, k)."""
        return inverse(self.information, self.scale)

    @property
    def total(self) -> float:
        """All deviances, and the prior's."""
        return float(sum(part.sum() for part in self.deviances)) + self.bent

    @property
    def deviances(self) -> list[np.ndarray]:
        """Of each window, (w,) each: `tempered` squares."""
        return [tempered(own, n) for own, n in zip(self.squares, self.samples, strict=True)]


def tempered(squares: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Squares up to the number of samples n, and n (1 + log(squares / n)) beyond, (w,): what fits worse than noise has
    noise of its own."""
    return np.minimum(squares, samples) + samples * np.log(np.maximum(squares / samples, 1.0))


def generalised(fits: Sequence[Fit], shades: Sequence[Colour]) -> Generalised:
    """The optimum near `fits`, which are of the same coordinates in several sets of windows; loud windows count less
    (iteratively reweighted)."""
    free, k = fits[0].coordinates, len(fits[0].coordinates.mean)
    linears = [shade.apply(fit.linear) for fit, shade in zip(fits, shades, strict=True)]
    ends = np.cumsum([k, *(linear.raw.shape[2] - k for linear in linears)])
    clock = np.ones(ends[-1] - k)
    prior, scale = np.append(free.sd, CLOCK * clock), np.append(free.scale, CLOCK * clock)
    z = np.append(free.read(fits[0].point.hypothesis), 0 * clock)
    far = np.append(TRUST * np.maximum(free.scale, np.abs(z[:k])), np.inf * clock)
    low, high = np.append(free.low, -np.inf * clock), np.append(free.high, np.inf * clock)
    low, high = np.maximum(low - z, -far), np.minimum(high - z, far)
    places = [np.append(np.arange(k), np.arange(*pair)) for pair in pairwise(ends)]
    lefts = [linear.off(fit.point.residual) for fit, linear in zip(fits, linears, strict=True)]
    samples = [fit.point.samples for fit in fits]
    weights = [np.ones(len(left)) for left in lefts]
    for _ in range(REWEIGHTED):
        hessian, slope = np.diag(prior**-2.0), np.append(-fits[0].pull, 0 * clock)
        for linear, left, place, weight in zip(linears, lefts, places, weights, strict=True):
            information, score = _weighted(linear.projected, left, weight)
            hessian[np.ix_(place, place)] += information
            slope[place] += score
        step = bounded(hessian, slope, scale, low, high)
        squares = [
            ((left - linear.projected @ step[place]) ** 2).sum(1)
            for linear, left, place in zip(linears, lefts, places, strict=True)
        ]
        weights = [1 / np.maximum(own / n, 1.0) for own, n in zip(squares, samples, strict=True)]
    aside = hessian[:k, k:] @ np.linalg.solve(hessian[k:, k:], hessian[k:, :k])
    bent = (((z + step - np.append(free.mean, 0 * clock)) / prior) ** 2).sum()
    return Generalised(squares, samples, step[:k], hessian[:k, :k] - aside, free.scale, float(bent))


def _weighted(projected: np.ndarray, left: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Information (c, c) and score (c,) of windows that count by `weight`, (w,)."""
    own = projected * weight[:, None, None]
    return np.einsum("wma,wmb->ab", own, projected), np.einsum("wma,wm->a", own, left)
