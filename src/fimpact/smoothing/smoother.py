"""Smoothing in weak-constraint form: trajectory, missing force, parameters and noise levels together.

    minimise  sum |y - h(x, tau)|^2 / R + sum |tau|^2 / S + prior(parameters),    x' = F(x, u, tau; parameters)

F is the model's own simulator over one sample. Gauss-Newton around the data: each step linearises every sample and
solves the whole by a Kalman filter and its adjoint; S, for each joint and contact mode, and R follow the gradient of
the marginal likelihood. References: Tremolet, QJRMS 132, 2006; Koopman, Biometrika 80(1), 1993; MacKay 1992.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from fimpact.deciding import FALL, LOUDER, ROUNDS, STILL, SWITCH, TRUST
from fimpact.effects.base import Placed
from fimpact.effects.sites import can_touch
from fimpact.smoothing.filtering import Filtered, filtered, swept, variances
from fimpact.smoothing.laws import touching
from fimpact.smoothing.linear import Linear, heavier, linearise, renewed
from fimpact.smoothing.parameters import Parameter, parameters, placed_of, theta_of
from fimpact.smoothing.states import States
from fimpact.smoothing.track import Track

WORN = 0.1  # of the noise, moved by a step: derivatives are renewed
INNER = 4  # updates of the noise levels between two linearisations
SMALL = 0.1  # of itself, that a number moves by: as much as one sd
LEAST = 1e-4  # of its first size: a missing force that is smaller is none
TRUSTED = (0.1, 30.0)  # times what the samples show: noise levels of the readings
FLIGHT, STANCE, CHANGE = 0, 1, 2  # contact modes


@dataclass(frozen=True)
class Levels:
    """Noise: sd of the missing force by mode, (modes, nv), least (nv,) it may be, and mode of each sample, (N,); sd of
    the readings, (ny,), and how much louder they are taken while a fit is annealed, (ny,)."""

    force: np.ndarray
    least: np.ndarray
    mode: np.ndarray
    reading: np.ndarray
    louder: np.ndarray

    @property
    def forces(self) -> np.ndarray:
        """sd of the missing force in each sample, (N, nv)."""
        return self.force[self.mode]


@dataclass(frozen=True)
class Smoothed:
    """A trajectory, the force that the model lacks along it, and the numbers estimated with them.

    tau: missing force, (N, nv), its posterior mean; doubt: posterior sd of the speeds, (N, nv). information: (p, p) of
    the coordinates of `numbers`, with their prior. chi2: of `count` innovations; loss: minus the logarithm of the
    marginal likelihood. still: how far the last step moved a reading, in sd.
    """

    track: Track
    placed: tuple[Placed, ...]
    priors: tuple[dict[str, float], ...]
    numbers: tuple[Parameter, ...]
    states: States
    tau: np.ndarray
    doubt: np.ndarray
    levels: Levels
    linear: Linear
    filter: Filtered
    information: np.ndarray
    chi2: float
    loss: float
    count: int
    converged: bool
    rounds: int
    still: float

    @property
    def theta(self) -> np.ndarray:
        """Values of the case's unknowns, (p,)."""
        return theta_of(self.numbers)


@dataclass(frozen=True)
class Solved:
    """One Gauss-Newton step: of the parameters (p,), of states and forces (N, m), and what the fit then is."""

    filter: Filtered
    step: np.ndarray
    change: np.ndarray
    adjoint: np.ndarray
    errors: np.ndarray
    information: np.ndarray
    chi2: float
    loss: float


def smooth(
    track: Track,
    begun: States,
    noise: np.ndarray,
    placed: Sequence[Placed] = (),
    priors: Sequence[dict[str, float]] = (),
    like: Smoothed | None = None,
    theta: np.ndarray | None = None,
    progress: Callable[[str], None] = lambda line: None,
    rounds: int = ROUNDS,
    frozen: bool = False,
) -> Smoothed:
    """Estimate trajectory, missing force, parameters and noise levels together.

    Args:
        begun: states to begin with, (N,). noise: sd of the readings, (ny,). placed: effects that are added; priors: sd
            of their amplitudes. like: an earlier result of the same track to begin with. theta: unknowns to begin with.
        frozen: the parameters stay as they are.
    """
    theta = theta if theta is not None else track.simulator.theta if like is None else like.theta
    numbers = [] if frozen else parameters(track.simulator, theta, placed, priors)
    fixed = parameters(track.simulator, theta, placed, priors)
    states, tau, doubt = begun, np.zeros_like(begun.qvel), np.full_like(begun.qvel, 1e-3)
    levels = None
    if like is not None:
        states, tau, doubt, levels = like.states, like.tau, like.doubt, like.levels
    anneal = list(LOUDER) if track.late.any() and like is None else []
    relax = 1.0
    pace, converged, k, change, linear, worn = Pace(), False, 0, np.inf, None, True
    for k in range(rounds + len(anneal)):
        linear = _linear(track, numbers, fixed, placed, states, tau, doubt, None if worn else linear)
        if levels is None:
            tau = _inverse(track, linear)
            levels = _first_levels(track, states, tau, noise)
            linear = _linear(track, numbers, fixed, placed, states, tau, doubt)
        loud = anneal[k] if k < len(anneal) else 1.0
        levels = replace(levels, louder=np.where(track.late, loud, 1.0))
        levels, shift = _levels(linear, levels, tau, numbers, noise, pace, track)
        found = solve(track, linear, levels, tau, numbers)
        if not np.isfinite(found.chi2):
            break
        before, change = change, _moves(linear, levels, found, track)
        # A kink is approached from both sides: what does not shrink is gone half the way.
        relax = max(relax / 2, 0.25) if change > 0.9 * before else relax if change > 0.5 * before else 1.0
        found = replace(found, change=relax * found.change, step=relax * found.step)
        n = track.space.size
        states, tau = track.space.plus(states, found.change[:, :n]), tau + found.change[:, n:]
        doubt = _doubts(track, linear, found)
        if numbers:
            numbers = [number.moved(step) for number, step in zip(numbers, found.step, strict=True)]
            fixed = numbers
            grown = heavier(track.model_of(placed_of(numbers, placed), theta_of(numbers)), linear.plant.model)
            tau, levels = tau * grown, replace(levels, force=levels.force * grown, least=levels.least * grown)
        levels = _modes(track, states, tau, levels)
        far = _farthest(found, numbers)
        worn = change > WORN or far > 10 * WORN
        progress(
            f"smoothing: step {k + 1}, readings move by {change:.2g} of their noise, numbers by {far:.2g} of their sd"
        )
        if k >= len(anneal) and max(change, shift / 4, far / 4) < STILL:
            converged = True
            break
    linear = _linear(track, numbers, fixed, placed, states, tau, doubt)
    found = solve(track, linear, levels, tau, numbers)
    count = int(np.isfinite(track.measured).sum())
    return Smoothed(
        track, placed_of(fixed, placed), tuple(priors), tuple(fixed), states, tau, doubt, levels, linear, found.filter,
        found.information, found.chi2, found.loss, count, converged, k + 1, float(change),
    )  # fmt: skip


def _linear(track, numbers, fixed, placed, states, tau, doubt, like: Linear | None = None) -> Linear:
    if like is not None:
        return renewed(like, track, fixed, placed, states, tau, doubt, theta_of(fixed))
    if numbers:
        return linearise(track, numbers, placed, states, tau, doubt)
    return linearise(track, [], placed_of(fixed, placed), states, tau, doubt, theta_of(fixed))


def _farthest(found: Solved, numbers: Sequence[Parameter]) -> float:
    """Largest step of a number that is not at its bound: in its sd, or where that is less, in `SMALL` parts of itself.

    Far from the noise the sd of white noise is a fraction of what a number is really known to.
    """
    sizes = np.abs(found.step * np.sqrt(np.diag(found.information)))
    own = [abs(s) if n.log else abs(s) / n.size for n, s in zip(numbers, found.step, strict=True)]
    both = [min(sd, part / SMALL) for sd, part in zip(sizes, own, strict=True)]
    return float(max((s for s, n in zip(both, numbers, strict=True) if not n.at_bound), default=0.0))


# ---- one step


def solve(track: Track, linear: Linear, levels: Levels, tau: np.ndarray, numbers: Sequence[Parameter]) -> Solved:
    """One Gauss-Newton step at given noise levels."""
    own = filtered(track, linear, levels)
    pulls = np.zeros((track.count, track.model.nv, linear.left.shape[2]))
    pulls[:, :, 0] = -tau
    innovations, kept = swept(track, linear, own, pulls)
    step, chi2, information = normal(innovations, numbers)
    mix = np.concatenate([[1.0], step])
    total, mean = np.ascontiguousarray(innovations @ mix)[:, :, None], kept @ mix
    adjoint, errors = own.adjoint(track, linear, total)
    n = track.space.size
    covered = np.einsum("kij,klj->kil", own.before, own.before)
    change = np.concatenate(
        [
            mean[:, :n] - np.einsum("kij,kj->ki", covered, adjoint[:, :n, 0]),
            mean[:, n:] - levels.forces**2 * adjoint[:, n:, 0],
        ],
        1,
    )
    known = np.isfinite(own.sd)
    prior = _occam(numbers, information, int(known.sum()))
    volume = np.linalg.slogdet(information)[1] if len(information) and np.isfinite(chi2) else 0.0
    loss = 0.5 * (2 * np.log(own.sd[known]).sum() + chi2 + volume + prior)
    return Solved(own, step, change, adjoint[:, :, 0], errors[:, :, 0], information, float(chi2), float(loss))


def normal(innovations: np.ndarray, numbers: Sequence[Parameter]) -> tuple[np.ndarray, float, np.ndarray]:
    """Step of the parameters, (p,), chi2 after it, and information (p, p) with the prior.

    Args:
        innovations: (N, ny, 1 + p) in sd.
    """
    data, columns = (
        innovations[:, :, 0].ravel(),
        -innovations[:, :, 1 : 1 + len(numbers)].reshape(innovations[:, :, 0].size, len(numbers)),
    )
    if not len(numbers):
        return np.zeros(0), float(data @ data), np.zeros((0, 0))
    slopes = np.array([n.slope for n in numbers])
    weight = np.array([1 / n.sd for n in numbers]) * slopes
    pull = np.array([(n.mean - n.value) / n.sd if np.isfinite(n.sd) else 0.0 for n in numbers])
    information = columns.T @ columns + np.diag(weight**2)
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    right = (columns.T @ data + weight * pull) / scale
    if not (np.isfinite(information).all() and np.isfinite(right).all()):
        return np.full(len(numbers), np.nan), np.inf, information
    step = _within(information / np.outer(scale, scale), right, *(scale * b for b in _reach(numbers))) / scale
    left, own = data - columns @ step, pull - weight * step
    return step, float(left @ left + own @ own), information


def _occam(numbers: Sequence[Parameter], information: np.ndarray, count: int) -> float:
    """What the priors of the numbers cost: their width, or where nothing is known, that of one reading (BIC)."""
    cost = 0.0
    for n, own in zip(numbers, np.diag(information), strict=True):
        told = np.isfinite(n.sd) and n.slope
        cost += 2 * np.log(n.sd / abs(n.slope)) if told else np.log(count) - np.log(max(own, 1e-300))
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


def _moves(linear: Linear, levels: Levels, found: Solved, track: Track) -> float:
    read = np.einsum("kai,ki->ka", linear.reads, found.change) / levels.reading
    known = np.isfinite(track.measured)
    return float(np.sqrt(np.mean(read[known] ** 2)))


def _doubts(track: Track, linear: Linear, found: Solved) -> np.ndarray:
    """Posterior sd of the speeds, (N, nv)."""
    nv = track.model.nv
    _, _, factors = variances(track, linear, found.filter)
    before = found.filter.before
    rows = before[:, nv : 2 * nv]
    told = rows @ (before.swapaxes(1, 2) @ factors)
    return np.sqrt(np.maximum((rows**2).sum(2) - (told**2).sum(2), 1e-24))


# ---- noise levels


class Pace:
    """How far levels are moved along the gradient: further as long as it points the same way."""

    def __init__(self):
        self.last, self.reach = None, None

    def __call__(self, gradient: np.ndarray) -> np.ndarray:
        """A step of the logarithms of the levels."""
        if self.last is None or self.last.shape != gradient.shape:
            self.reach = np.ones_like(gradient)
        else:
            same = np.sign(self.last) == np.sign(gradient)
            self.reach = np.where(same, np.minimum(2 * self.reach, 8.0), 1.0)
        self.last = gradient
        return np.clip(self.reach * gradient, -np.log(FALL), np.log(FALL))


def _levels(linear, levels: Levels, tau, numbers, noise, pace: Pace, track: Track) -> tuple[Levels, float]:
    """Levels nearer to the greatest marginal likelihood, and by how much they moved in all, in logarithms."""
    begun = levels
    for _ in range(INNER):
        found = solve(track, linear, levels, tau, numbers)
        if not np.isfinite(found.chi2):
            return levels, np.inf
        force, errors, _ = variances(track, linear, found.filter)
        n = track.space.size
        asked, expected = found.adjoint[:, n:] ** 2, force
        rows = [levels.mode == mode for mode in range(len(levels.force))]
        ratio = np.array([_ratio(asked[r].sum(0), expected[r].sum(0)) for r in rows])
        step = pace(np.log(ratio) / 2)
        sd = np.clip(levels.force * np.exp(step), begun.force / FALL, begun.force * FALL)
        sd = np.maximum(sd, levels.least)
        known = np.isfinite(track.measured)
        loud = _ratio((found.errors**2 * known).sum(0), (errors * known).sum(0)) ** 0.5
        low, high = TRUSTED
        reading = np.clip(levels.reading * np.where(levels.louder > 1, 1.0, loud), low * noise, high * noise)
        levels = replace(levels, force=sd, reading=reading)
    weighty = levels.force > 10 * levels.least
    shift = np.abs(np.log(levels.force / begun.force))[weighty].max(initial=0.0)
    return levels, float(shift)


def _ratio(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    return np.where(expected > 0, np.maximum(found, 1e-300) / np.maximum(expected, 1e-300), 1.0)


def _first_levels(track: Track, states: States, tau: np.ndarray, noise: np.ndarray) -> Levels:
    sd = np.sqrt(np.mean(tau**2, 0)) + 1e-12
    levels = Levels(sd[None], LEAST * sd, np.zeros(track.count, int), noise.copy(), np.ones(len(noise)))
    return _modes(track, states, tau, levels)


def _modes(track: Track, states: States, tau: np.ndarray, levels: Levels) -> Levels:
    """Contact modes anew: flight, stance, and the few samples about a change of the two."""
    if not can_touch(track.model):
        return levels
    now = touching(track, states)
    mode = np.where(now, STANCE, FLIGHT)
    for rows in track.slices():
        for at in rows.start + 1 + np.flatnonzero(now[rows][1:] != now[rows][:-1]):
            mode[max(at - SWITCH, rows.start) : min(at + SWITCH, rows.stop)] = CHANGE
    force = levels.force
    if len(force) == 1:
        own = [np.sqrt(np.mean(tau[mode == m] ** 2, 0)) + 1e-12 if (mode == m).any() else force[0] for m in range(3)]
        force = np.array(own)
    return replace(levels, mode=mode, force=np.maximum(force, levels.least))


def _inverse(track: Track, linear: Linear) -> np.ndarray:
    """The force, (N, nv), that takes each sample's state to the next's.

    Positions count beside speeds: under a stiff servo a held force moves a joint, and its speed has died away.
    """
    tau = np.einsum("kji,ki->kj", inverse_of_push(track, linear), -linear.offsets[:, : 2 * track.model.nv, 0])
    tau[track.last] = 0.0
    return tau


def inverse_of_push(track: Track, linear: Linear) -> np.ndarray:
    """The force that a change of the next sample's positions and speeds would take, (N, nv, 2 nv)."""
    nv = track.model.nv
    scale = np.repeat([1.0, track.period], nv)
    push = linear.advance[:, : 2 * nv, track.space.size :] * scale[:, None]
    return np.linalg.pinv(push, rcond=1e-9) * scale
