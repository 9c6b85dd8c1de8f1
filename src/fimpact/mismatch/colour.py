"""The colour of what disturbs a robot: forces that nobody commands and that differ from window to window.

A draught, a cable, a warm motor push for longer than a sample. Such a force is taken for a random one that forgets
itself exponentially (Ornstein-Uhlenbeck), one size for each degree of freedom and one memory, both at their restricted
likelihood's maximum. Through the sensitivities to forces that gives the covariance of the residual, I + P K P'. Its
size is read from the residual itself, so a missing effect counts as noise here at first: that costs power and never
honesty.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Linear
from fimpact.mismatch.pulses import BINS, Pulses

CLOCK = 0.02  # of the sampling period: sd of a run's clock against that of its commands
FEW = 8  # windows
SIZES = (-9.0, 14.0)  # log of the variance, in units of what the sensors show of it
MEMORIES = (-1.0, 3.5)  # log of the memory, in bins


@dataclass(frozen=True)
class Disturbance:
    """Standard deviation of the random force on each degree of freedom, (nv,), N or N m, and its memory in bins."""

    sd: np.ndarray
    memory: float

    def root(self) -> np.ndarray:
        """Cholesky factor of the covariance of the pulses, (nv * BINS, nv * BINS)."""
        apart = np.abs(np.subtract.outer(np.arange(BINS), np.arange(BINS)))
        return np.kron(np.diag(self.sd), np.linalg.cholesky(np.exp(-apart / self.memory) + 1e-9 * np.eye(BINS)))


@dataclass(frozen=True)
class Colour:
    """Orthonormal directions (w, m, c) in which the residual of each window is louder than noise by sd `louder`, (w, c),
    and what a late clock of each run does to it, (w, m, runs)."""

    directions: np.ndarray
    louder: np.ndarray
    clocks: np.ndarray

    def white(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, m, k), in units in which the residual is white."""
        along = self.directions.transpose(0, 2, 1) @ columns
        return columns - self.directions @ (along * (1 - 1 / self.louder)[:, :, None])

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

    def read(z):
        return Disturbance(np.exp(z[:nv] / 2) * unit, float(np.exp(z[nv])))

    def unlikely(z):
        root = read(z).root()
        inner = np.eye(len(root)) + root.T @ gram @ root
        shown = along @ root
        return (np.linalg.slogdet(inner)[1] - (shown * np.linalg.solve(inner, shown[..., None])[..., 0]).sum(1)).sum()

    if len(left) < FEW:
        return Disturbance(np.zeros(nv), 1.0)
    best = minimize(unlikely, np.append(np.zeros(nv), 1.0), method="L-BFGS-B", bounds=[SIZES] * nv + [MEMORIES])
    return read(best.x)


def colour(found: Pulses, pushing: Disturbance) -> Colour:
    """What `pushing` makes of the noise in the windows of `found`."""
    directions, size, _ = np.linalg.svd(found.columns @ pushing.root(), full_matrices=False)
    return Colour(directions, np.sqrt(1 + size**2), found.clocks)


def coloured(fitted: Fit, found: Pulses) -> Fit:
    """`fitted` with its problem in units in which disturbances are white noise, and with a clock of its own for each
    run as further coordinates."""
    shade = colour(found, disturbance(fitted, found))
    linear, prior = shade.apply(fitted.linear), shade.with_clocks(fitted.coordinates.sd, CLOCK)
    precision = np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(prior**-2.0)
    scale, pull = shade.with_clocks(fitted.scale, CLOCK), shade.with_clocks(fitted.pull, 0.0)
    return replace(fitted, linear=linear, precision=precision, scale=scale, pull=pull)


def generalised(fitted: Fit, shade: Colour) -> np.ndarray:
    """Squares of each window, (w,), at the generalised least-squares optimum one linear step from `fitted`."""
    linear, free = shade.apply(fitted.linear), fitted.coordinates
    low, high = shade.with_clocks(free.low, -np.inf), shade.with_clocks(free.high, np.inf)
    prior, scale = shade.with_clocks(free.sd, CLOCK), shade.with_clocks(free.scale, CLOCK)
    z = shade.with_clocks(free.read(fitted.point.hypothesis), 0.0)
    left = linear.off(fitted.point.residual)
    slope = np.einsum("wma,wm->a", linear.projected, left) - shade.with_clocks(fitted.pull, 0.0)
    scale = scale * ~(((z <= low) & (slope < 0)) | ((z >= high) & (slope > 0)))
    hessian = np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(prior**-2.0)
    step = scale * np.linalg.lstsq(hessian * np.outer(scale, scale), slope * scale, rcond=1e-12)[0]
    step = np.clip(z + step, low, high) - z
    return ((left - linear.projected @ step) ** 2).sum(1)


def covariance(fitted: Fit, found: Pulses, pushing: Disturbance) -> np.ndarray:
    """Of the coordinates of a least-squares fit under such a disturbance and late clocks, (k, k): White's sandwich."""
    own, slopes = fitted.covariance, fitted.linear.projected
    shown = pushing.root().T @ np.einsum("wmb,wma->wba", found.columns, slopes)
    late = CLOCK * np.einsum("wmr,wma->ra", found.clocks, slopes)
    return own + own @ (np.einsum("wba,wbc->ac", shown, shown) + late.T @ late) @ own
