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
from fimpact.mismatch.problem import Linear, Problem
from fimpact.mismatch.pulses import BINS, Pulses

CLOCK = 0.02  # of the sampling period: sd of a run's clock against that of its commands
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
    """Orthonormal directions (w, m, c) in which the residual of each window is louder than noise by sd `louder`, (w, c)."""

    directions: np.ndarray
    louder: np.ndarray

    def white(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, m, k), in units in which the residual is white."""
        along = self.directions.transpose(0, 2, 1) @ columns
        return columns - self.directions @ (along * (1 - 1 / self.louder)[:, :, None])

    def apply(self, linear: Linear) -> Linear:
        """`linear`, which knows no colour, in those units."""
        basis, triangle = np.linalg.qr(self.white(linear.basis @ linear.triangle))
        new = Linear(basis, triangle, linear.raw, linear.raw, self)
        return replace(new, projected=new.off(linear.raw))


def disturbance(fitted: Fit, found: Pulses) -> Disturbance:
    """The disturbance under which the residual of `fitted` is most likely."""
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

    best = minimize(unlikely, np.append(np.zeros(nv), 1.0), method="L-BFGS-B", bounds=[SIZES] * nv + [MEMORIES])
    return read(best.x)


def colour(found: Pulses, pushing: Disturbance) -> Colour:
    """What `pushing` makes of the noise in the windows of `found`."""
    directions, size, _ = np.linalg.svd(found.columns @ pushing.root(), full_matrices=False)
    return Colour(directions, np.sqrt(1 + size**2))


def coloured(problem: Problem, fitted: Fit, found: Pulses) -> Fit:
    """`fitted` with its problem in units in which disturbances are white noise, and with a clock of its own for each
    run as further coordinates."""
    plain = replace(fitted.linear, raw=np.concatenate([fitted.linear.raw, _clocks(problem, fitted)], 2))
    noisy = colour(found, disturbance(fitted, found)).apply(plain)
    runs = plain.raw.shape[2] - len(fitted.pull)
    prior = np.append(fitted.coordinates.sd, np.full(runs, CLOCK))
    precision = np.einsum("wma,wmb->ab", noisy.projected, noisy.projected) + np.diag(prior**-2.0)
    scale = np.append(fitted.scale, np.full(runs, CLOCK))
    return replace(fitted, linear=noisy, precision=precision, scale=scale, pull=np.append(fitted.pull, np.zeros(runs)))


def generalised(fitted: Fit, shade: Colour) -> np.ndarray:
    """Squares of each window, (w,), at the generalised least-squares optimum one linear step from `fitted`."""
    linear, free = shade.apply(fitted.linear), fitted.coordinates
    left, z, bent = linear.off(fitted.point.residual), free.read(fitted.point.hypothesis), fitted.pull
    slope = np.einsum("wma,wm->a", linear.projected, left) - bent
    open_ = ~(((z <= free.low) & (slope < 0)) | ((z >= free.high) & (slope > 0)))
    scale = free.scale * open_
    hessian = np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(free.sd**-2.0)
    scaled = hessian * np.outer(scale, scale)
    step = scale * np.linalg.lstsq(scaled, slope * scale, rcond=1e-12)[0] if len(z) else z
    step = np.clip(z + step, free.low, free.high) - z
    return ((left - linear.projected @ step) ** 2).sum(1)


def covariance(fitted: Fit, found: Pulses, pushing: Disturbance) -> np.ndarray:
    """Of the coordinates of a least-squares fit under such a disturbance, (k, k): White's sandwich."""
    own, slopes = fitted.covariance, fitted.linear.projected
    shown = pushing.root().T @ np.einsum("wmb,wma->wba", found.columns, slopes)
    return own + own @ np.einsum("wba,wbc->ac", shown, shown) @ own


def _clocks(problem: Problem, fitted: Fit) -> np.ndarray:
    """Change of the prediction by a clock that is one period late, for each run, (w, m, runs)."""
    point, windows = fitted.point, problem.windows
    predicted = problem.simulator.predict(point.hypothesis, windows, point.qpos, point.qvel)
    late = problem.whiten(-np.gradient(predicted, axis=1))
    own = windows.runs[:, None] == np.unique(windows.runs)
    return problem.extend(late[:, :, None] * own[:, None, :])
