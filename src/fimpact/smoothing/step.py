"""One Gauss-Newton step of a smoother: of states, missing forces and numbers, at given noise levels.

What is left of a model is no white noise: the data count as much as independent stretches of them bear out (a sandwich
of the scores, Liang and Zeger 1986), so that a prior is not overruled by samples that repeat one another.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import lsq_linear

from fimpact.deciding import CONFIDENCE, STILL, TRUST
from fimpact.smoothing.dynamics.linear import Linear
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.filter.by_run import Filtered, filtered, swept, variances
from fimpact.smoothing.noise_levels import Levels, Pace, moved_by, nearer
from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.stretches import spread_of_scores

NORMAL = float(stats.norm.ppf((1 + CONFIDENCE) / 2))  # sd, within which so many of normal variables are
INNER = 4  # updates of the noise levels between two linearisations
SMALL = 0.1  # of itself, that a number moves by: as much as one sd


@dataclass(frozen=True)
class Solved:
    """One Gauss-Newton step: of the numbers (p,), of states and forces (N, m), and what the fit then is.

    surprise: (N, ny), what readings of forces and
    accelerations hold at the linearisation beyond what readings before them foretold, 0 of others.
    information: (p, p), of the coordinates, with their prior; dispersion: by how much the data count less than white
    noise would. chi2: of the innovations. fit, cost: minus the logarithms of likelihood and of prior by posterior.
    """

    filter: Filtered
    step: np.ndarray
    change: np.ndarray
    adjoint: np.ndarray
    errors: np.ndarray
    surprise: np.ndarray
    information: np.ndarray
    dispersion: float
    chi2: float
    fit: float
    cost: float

    def farthest(self, numbers: Sequence[Parameter]) -> float:
        """Largest step of a number that is not at its bound: in its sd, or where that is less, in `SMALL` parts of
        itself."""
        own = [abs(s) if n.log else abs(s) / n.size for n, s in zip(numbers, self.step, strict=True)]
        scale = np.sqrt(np.maximum(np.diag(self.information), np.finfo(float).tiny))
        spread = np.linalg.pinv(self.information / np.outer(scale, scale), rcond=1e-12, hermitian=True)
        sd = np.sqrt(np.maximum(np.diag(spread), 1e-300)) / scale
        both = [min(far, part / SMALL) for far, part in zip(np.abs(self.step) / sd, own, strict=True)]
        return float(max((s for s, n in zip(both, numbers, strict=True) if not n.at_bound), default=0.0))

    def moves(self, linear: Linear, levels: Levels, track: Track) -> float:
        """By how much it moves the readings, in sd, root mean square of all but the few at a contact or a reversal
        that jump from side to side of it."""
        read = np.einsum("kai,ki->ka", linear.reads, self.change) / levels.reading
        own = np.abs(read[np.isfinite(track.measured)])
        return float(np.quantile(own, CONFIDENCE) / NORMAL) if len(own) else 0.0

    def doubts(self, linear: Linear, track: Track) -> np.ndarray:
        """Posterior sd of the speeds, (N, nv)."""
        nv = track.model.nv
        _, _, factors = variances(track, linear, self.filter)
        before = self.filter.before
        rows = before[:, nv : 2 * nv]
        told = rows @ (before.swapaxes(1, 2) @ factors)
        return np.sqrt(np.maximum((rows**2).sum(2) - (told**2).sum(2), 1e-24))


def solve(
    track: Track,
    linear: Linear,
    levels: Levels,
    tau: np.ndarray,
    numbers: Sequence[Parameter],
    stretch: np.ndarray,
    dispersion: float | None = None,
) -> Solved:
    """One Gauss-Newton step at given noise levels.

    Args:
        stretch: of each sample, (N,). dispersion: of the step before, which is not left at once.
    """
    own = filtered(track, linear, levels)
    pulls = np.zeros((track.count, track.model.nv, linear.left.shape[2]))
    pulls[:, :, 0] = -tau
    innovations, kept = swept(track, linear, own, pulls)
    step, chi2, penalty, information, dispersion = normal(innovations, numbers, stretch, dispersion)
    mix = np.concatenate([[1.0], step])
    total, mean = np.ascontiguousarray(innovations @ mix)[:, :, None], kept @ mix
    adjoint, errors = own.adjoint(track, linear, total)
    n = linear.advance.shape[1]
    covered = np.einsum("kij,klj->kil", own.before, own.before)
    change = np.concatenate(
        [
            mean[:, :n] - np.einsum("kij,kj->ki", covered, adjoint[:, :n, 0]),
            mean[:, n:] - levels.forces**2 * adjoint[:, n:, 0],
        ],
        1,
    )
    change[:, linear.rubbed.shape[1] : n] = 0.0  # a clock is estimated anew in each step, and nothing is moved by it
    known = np.isfinite(own.sd)
    prior = occam(numbers, information, int(known.sum()))
    volume = _volume(information) if len(information) and np.isfinite(chi2) else 0.0
    fit, cost = 0.5 * (2 * np.log(own.sd[known]).sum() + chi2), 0.5 * (penalty + volume + prior)
    # Not white noise's infinity: where nothing was read, nothing surprises.
    surprise = np.where(known & track.late, total[:, :, 0] * np.where(known, own.sd, 0.0) - linear.left[:, :, 0], 0.0)
    return Solved(
        own, step, change, adjoint[:, :, 0], errors[:, :, 0], surprise, information, dispersion, float(chi2),
        float(fit), float(cost),
    )  # fmt: skip


def adapted(
    track: Track,
    linear: Linear,
    levels: Levels,
    tau: np.ndarray,
    numbers: Sequence[Parameter],
    stretch: np.ndarray,
    noise: np.ndarray,
    pace: Pace,
) -> Levels:
    """Levels nearer to the greatest marginal likelihood at one linearisation, as `solve` and `nearer` have it."""
    begun = levels
    for _ in range(INNER):
        last = levels
        found = solve(track, linear, levels, tau, numbers, stretch)
        if not np.isfinite(found.chi2):
            break
        expected = variances(track, linear, found.filter)[:2]
        asked = found.adjoint[:, linear.advance.shape[1] :]
        levels = nearer(levels, begun, asked, found.errors, expected, noise, pace, track)
        if moved_by(levels, last) < STILL / 2:
            break
    return levels


def _volume(information: np.ndarray) -> float:
    """Logarithm of the determinant; what nothing is known of counts as its diagonal has it."""
    size = np.maximum(np.diag(information), 1e-300)
    alike = information / np.sqrt(size)[:, None] / np.sqrt(size)
    np.fill_diagonal(alike, 1.0)
    return float(np.log(size).sum() + np.linalg.slogdet(alike)[1])


def normal(
    innovations: np.ndarray, numbers: Sequence[Parameter], stretch: np.ndarray, before: float | None = None
) -> tuple[np.ndarray, float, float, np.ndarray, float]:
    """Step of the numbers, (p,); chi2 and penalty of their prior after it; information (p, p) and dispersion.

    Args:
        innovations: (N, ny, 1 + p) in sd. stretch: of each sample, (N,), rising. before: dispersion of the step before.
    """
    p = len(numbers)
    data, columns = innovations[:, :, 0], -innovations[:, :, 1 : 1 + p]
    flat = columns.reshape(data.size, p)
    if not p:
        return np.zeros(0), float(data.ravel() @ data.ravel()), 0.0, np.zeros((0, 0)), 1.0
    weight, pull = np.array([1 / n.spread for n in numbers]), np.array([n.away for n in numbers])
    gram, right = flat.T @ flat, flat.T @ data.ravel()
    if not (np.isfinite(gram).all() and np.isfinite(right).all()):
        return np.full(p, np.nan), np.inf, 0.0, gram, 1.0
    reach = _reach(numbers)
    white = _scaled(gram + np.diag(weight**2), right + weight * pull, reach)
    begins = np.flatnonzero(np.diff(stretch, prepend=-1))
    scores = np.add.reduceat(((data - columns @ white)[:, :, None] * columns).sum(1), begins)
    dispersion = spread_of_scores(scores, np.diag(gram)) if len(begins) > p else 1.0
    dispersion = dispersion if before is None else float(np.sqrt(dispersion * before))
    information = gram / dispersion + np.diag(weight**2)
    step = white
    if dispersion > 1:
        step = _scaled(information, right / dispersion + weight * pull, reach)
    left, own = data.ravel() - flat @ step, pull - weight * step
    return step, float(left @ left), float(own @ own), information, dispersion


def _scaled(information: np.ndarray, right: np.ndarray, reach: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    bounds = (scale * bound for bound in reach)
    return _within(information / np.outer(scale, scale), right / scale, *bounds) / scale


def occam(numbers: Sequence[Parameter], information: np.ndarray, count: int) -> float:
    """What the priors of the numbers cost: their width, or where nothing is known, that of one reading (BIC)."""
    cost = 0.0
    for n, own in zip(numbers, np.diag(information), strict=True):
        cost += 2 * np.log(n.spread) if np.isfinite(n.spread) else np.log(count) - np.log(max(own, 1e-300))
    return cost


def _reach(numbers: Sequence[Parameter]) -> tuple[np.ndarray, np.ndarray]:
    """How far each coordinate may go in a step, down and up, (p,) each."""
    far = np.log(TRUST)
    low = [-far if n.log else n.low - n.value for n in numbers]
    high = [far if n.log else n.high - n.value for n in numbers]
    return np.array(low) - 1e-12, np.array(high) + 1e-12


def _within(matrix: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The minimum of the quadratic form, (p,), within bounds: what is held at one does not hold the others back."""
    step = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
    if np.all((step >= low) & (step <= high)):
        return step
    values, axes = np.linalg.eigh(matrix)
    root = np.sqrt(np.maximum(values, 1e-12 * values.max()))
    return lsq_linear(root[:, None] * axes.T, axes.T @ right / root, (low, high), method="bvls").x
