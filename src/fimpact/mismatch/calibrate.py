"""What the largest of many scores would be if nothing were missing.

Sensor noise is white and known; what disturbs a robot is neither. Both reach the measurements through the mechanism,
so a score is judged against the rest of what forces can explain of the residual, not against the sensors alone: a
candidate must stand out among all forces. Its p is adjusted for all candidates together by drawing their scores jointly
(max-T; Westfall & Young 1993), because most of them imitate one another.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm
from scipy.stats import f as fisher
from scipy.stats import t as student

from fimpact.mismatch.fit import Fit
from fimpact.mismatch.pulses import Pulses

DRAWS = 4000
SMALLEST = -600.0  # log of the smallest tail probability that is told from zero
USED = 1e-6  # of the largest singular value; below it a force changes nothing
NEGLIGIBLE = 1e-5  # of the largest variance of joint scores: what is smaller moves none of them


@dataclass(frozen=True)
class Background:
    """What forces of any kind explain of a residual: their energy (sum of squares) and degrees of freedom."""

    energy: float
    freedom: int

    def scale(self, taken: np.ndarray | float, count: int = 1) -> np.ndarray:
        """Variance of a score, at least 1, once `taken` of the energy is put down to `count` candidates."""
        rest = np.maximum(self.energy - taken, 0.0) / max(self.freedom - count, 1)
        return np.maximum(rest, 1.0)


def background(fitted: Fit, found: Pulses) -> Background:
    """Energy of the residual of `fitted` in the space that the pulses span."""
    free = fitted.linear.off(found.columns)
    basis, values, _ = np.linalg.svd(free / np.maximum(np.abs(free).max((0, 1)), 1e-300), full_matrices=False)
    used = values > USED * values.max()
    along = np.einsum("wmb,wm->wb", basis, fitted.linear.off(fitted.point.residual)) * used
    return Background(float((along**2).sum()), int(used.sum()) - fitted.linear.raw.shape[2])


@dataclass(frozen=True)
class Carried:
    """What a disturbance that outlasts a window adds to the variance of a score, as a share of what windows apart would
    have, and how many independent pieces the windows then are, (c,) each."""

    share: np.ndarray | float = 0.0
    pieces: np.ndarray | float = 2.0

    def freedom(self, apart: float) -> np.ndarray:
        """Of the variance of a score, `apart` without it (Satterthwaite): a few pieces say little of their size."""
        return (1 + self.share) ** 2 / (1 / apart + self.share**2 / np.maximum(self.pieces - 1, 1.0))


def carried(fitted: Fit, found: Pulses, columns: np.ndarray, before: Fit) -> Carried:
    """What the disturbance under which `fitted` is coloured carries from window to window of a run, for scores of
    projected sensitivities `columns`, (w m, c). Pieces are as long as the memory `before`: the less a slow force
    changes, the more of it a candidate takes for itself, and what is left looks quick."""
    pushing, longest = fitted.linear.colour.pushing, before.linear.colour.pushing.memory
    own = columns.reshape(len(found.time), -1, columns.shape[1])
    first, last = (fitted.linear.off(end * pushing.sd).transpose(0, 2, 1) @ own for end in found.ends(pushing.memory))
    # Of an exponential memory, what a window shares with an earlier one is a product of what each has by itself.
    earlier = np.greater.outer(found.middle, found.middle) * found.kept(pushing.memory)
    together = 2 * np.einsum("wdc,wv,vdc->c", first, earlier, last, optimize=True)
    counted = (own**2).sum(1)
    squares = (counted * (found.kept(max(longest, pushing.memory)) ** 2 @ counted)).sum(0)
    total = counted.sum(0)
    return Carried(np.maximum(together / total, 0.0), total**2 / squares)


def adjusted(
    z: np.ndarray,
    columns: np.ndarray,
    two_sided: np.ndarray,
    behind: Background,
    lasting: Carried = Carried(),
    seed: int = 0,
) -> np.ndarray:
    """p of each candidate, (c,), adjusted for all of them.

    Args:
        z: scores in standard deviations of the sensors' noise, (c,). columns: their projected sensitivities, (m, c).
        two_sided: whether a negative score counts as well, (c,). lasting: what disturbances carry between windows.
    """
    # Student's t where little is left to scale by.
    sd, freedom = np.sqrt(behind.scale(z**2) * (1 + lasting.share)), lasting.freedom(max(behind.freedom - 1, 1))
    t = _as(norm, student(freedom).logsf(np.abs(z) / sd)) * np.sign(z)
    drawn = _joint_draws((columns / np.sqrt((columns**2).sum(0))).astype(np.float32), seed)
    largest = np.where(two_sided, np.abs(drawn), drawn).max(1)
    return _p(np.where(two_sided, np.abs(t), t), largest)


def adjusted_groups(
    groups: list[np.ndarray], residual: np.ndarray, behind: Background, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """p of each group of projected sensitivities, (m, c) each, tested together against `residual`, (m,), the energy
    that each explains beyond what it would of noise, and what tells apart those whose p is as small as draws can say.
    """
    bases = [np.linalg.svd(group, full_matrices=False)[0] for group in groups]
    size = np.array([basis.shape[1] for basis in bases])
    energy = np.array([((residual @ basis) ** 2).sum() for basis in bases])
    ratio = energy / size / np.array([behind.scale(e, n) for e, n in zip(energy, size, strict=True)])
    rest = behind.freedom - size
    # Fisher's F where little is left to scale by, and no evidence where nothing is.
    tails = np.where(rest > 0, fisher.logsf(ratio, size, np.maximum(rest, 1)), 0.0)
    observed = _as(chi2, tails, size)
    drawn = _joint_draws(np.concatenate(bases, 1, dtype=np.float32), seed) ** 2
    sums = np.add.reduceat(drawn, np.cumsum(size) - size, axis=1)
    stands_out = _root(observed, size)
    return _p(stands_out, _root(sums, size).max(1)), np.maximum(energy - size, 0.0), stands_out


def _as(distribution, log_tail: np.ndarray, *shape) -> np.ndarray:
    """Where `distribution`, of that `shape`, has the tail probability exp(log_tail)."""
    return distribution.isf(np.exp(np.maximum(log_tail, SMALLEST)), *shape)


def _root(squares: np.ndarray, size: np.ndarray) -> np.ndarray:
    # Fisher's: a chi-square of any size on one scale.
    return np.sqrt(2 * squares) - np.sqrt(2 * size - 1)


def _joint_draws(unit: np.ndarray, seed: int) -> np.ndarray:
    """Scores of noise, (DRAWS, c), correlated as columns of length one, (m, c), are: single precision is more than
    chance needs."""
    values, vectors = np.linalg.eigh(unit.T @ unit)
    used = values > NEGLIGIBLE * values[-1]
    values, root = values[used], vectors[:, used] * np.sqrt(values[used])
    return np.random.default_rng(seed).standard_normal((DRAWS, len(values)), np.float32) @ root.T


def _p(observed: np.ndarray, largest: np.ndarray) -> np.ndarray:
    return (1 + (largest[:, None] >= observed - 1e-12).sum(0)) / (1 + DRAWS)
