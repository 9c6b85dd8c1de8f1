"""The disturbance: forces that nobody commands and that differ from window to window.

A draught, a cable, a warm motor push for longer than a sample. Such a force is taken for a random one that forgets
itself exponentially (Ornstein-Uhlenbeck), one size for each degree of freedom and one memory, both at their restricted
likelihood's maximum. Its size is read from the residual itself, so a missing effect counts as noise here at first: that
costs power and never honesty.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.pulses import BINS, Felt

FEW = 8  # windows
SIZES = (-9.0, 20.0)  # log of the variance, in units of what the sensors show of it
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
        return np.kron(np.diag(self.sd), _correlated(self.memory))


def disturbance(fitted: Fit, found: Felt) -> Disturbance:
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
    whole = np.linalg.inv(_correlated(pushing.memory))
    longer = whole @ (np.exp(-apart) * apart) @ whole.T
    slopes = [np.append(np.trace(own, axis1=1, axis2=2), (own * longer).sum()) for own in (used, took)]
    return -np.linalg.slogdet(inner)[1].sum(), float((shown * kept).sum()), *slopes


def _correlated(memory: float) -> np.ndarray:
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
