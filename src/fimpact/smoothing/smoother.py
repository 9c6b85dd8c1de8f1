"""Smoothing in weak-constraint form: trajectory, missing force, numbers and noise levels together.

    minimise  sum |y - h(x, tau)|^2 / R + sum |tau|^2 / S + prior(numbers),    x' = F(x, u, tau; numbers)

F is the model's own simulator over one sample. Gauss-Newton around the data: each step linearises every sample and
solves the whole by a Kalman filter and its adjoint; S, for each joint and contact mode, and R follow the gradient of
the marginal likelihood. References: Tremolet, QJRMS 132, 2006; Koopman, Biometrika 80(1), 1993.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import LOUDER, ROUNDS, STILL, TIED, TRUST
from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.linear import Linear, missing_at_first
from fimpact.smoothing.dynamics.rotor_states import with_rotors
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.filter.by_run import Filtered
from fimpact.smoothing.noise_levels import Levels, Pace, first_levels, moved_by
from fimpact.smoothing.parameters import Parameter, parameters, placed_of, theta_of
from fimpact.smoothing.rounds import Fitted, is_ahead, linear_at, runs_away
from fimpact.smoothing.states import States
from fimpact.smoothing.step import Solved, adapted, solve
from fimpact.smoothing.stretches import stretches

WORN = 0.1  # of the noise, moved by a step: derivatives are renewed
FAR = 4.0  # sd of a number, or logarithms of a noise level, that count as much as a reading's noise
SHRINKS = 0.7  # of the last step: a next one that is longer does not converge by itself
RUNS_AWAY = (
    "The model runs away within one sample of the recording: its states there are no states of the model. "
    "Measure the joints that close a loop, or give the model a start that keeps its constraints."
)
LEAST_CUT = 1e-2  # of a step that runs away
ROUNDS_ABOVE_BAR = 2  # rounds in a row that fit worse than a fit has to, and fall too slowly to get there


@dataclass(frozen=True)
class Smoothed:
    """A trajectory, the force that the model lacks along it, and the numbers estimated with them.

    tau: missing force, (N, nv), its posterior mean; doubt: posterior sd of the speeds, (N, nv). surprise: (N, ny), as
    in `laws.read_by`. information: (p, p) of the coordinates of `numbers`, with their prior. dispersion: by how much
    the data count less than white noise would. chi2: of `count` innovations; fit, cost: minus the logarithms of
    likelihood and of prior by posterior. still: how far the last step moved a reading, in sd.
    """

    track: Track
    placed: tuple[Placed, ...]
    priors: tuple[dict[str, float], ...]
    numbers: tuple[Parameter, ...]
    states: States
    tau: np.ndarray
    doubt: np.ndarray
    surprise: np.ndarray
    levels: Levels
    linear: Linear
    filter: Filtered
    information: np.ndarray
    dispersion: float
    chi2: float
    fit: float
    cost: float
    count: int
    converged: bool
    rounds: int
    still: float

    @property
    def missing(self) -> np.ndarray:
        """Squared missing force, (contact modes, nv)."""
        return self.levels.summed(self.tau**2)

    @property
    def theta(self) -> np.ndarray:
        """Values of the case's unknowns, (p,)."""
        return theta_of(self.numbers)

    def loss(self, dispersion: float = 1.0) -> float:
        """Minus the logarithm of the marginal likelihood of data that count one in `dispersion`: fits are compared at
        the same."""
        return self.fit / dispersion + self.cost


@np.errstate(over="ignore", invalid="ignore")  # a fit that runs away ends, and says so
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
    patience: int | None = None,
    bar: float = np.inf,
) -> Smoothed:
    """Estimate trajectory, missing force, numbers and noise levels together.

    Args:
        begun: states to begin with, (N,). noise: sd of the readings, (ny,). placed: effects that are added; priors: sd
            of their amplitudes. like: an earlier result to begin with. theta: unknowns to begin with.
        frozen: the numbers stay as they are. bar: loss that the fit must beat; where it falls too slowly to get
            there, it ends, and has not converged. patience: rounds that fit worse than an earlier one, after which the
            fit ends with that one; None: it goes on, and ends with the last.
    """
    theta = theta if theta is not None else track.simulator.theta if like is None else like.theta
    fixed = parameters(track.simulator, theta, placed, priors)
    numbers = [] if frozen else fixed
    states = with_rotors(track, begun, (), placed)
    tau, doubt = np.zeros_like(begun.qvel), np.full_like(begun.qvel, 1e-3)
    levels, linear, stretch, dispersion, surprise = None, None, None, None, np.zeros_like(track.measured)
    if like is not None:
        tau, doubt, levels, surprise = like.tau, like.doubt, like.levels, like.surprise
        states = with_rotors(track, like.states, like.placed, placed, like.linear.plant.driven)
        linear = like.linear if like.track is track else None
    # Rotors move what touches, too.
    anew = like is None or like.states.size != states.size
    anneal = list(LOUDER) if track.late.any() and anew else []
    sign, last_step, last_sign, relax = None, np.inf, None, 1.0
    pace, converged, k, change, count = Pace(), False, 0, np.inf, int(np.isfinite(track.measured).sum())
    taken: tuple[Fitted, Solved, Linear] | None = None  # the last step, and whence
    cut = 1.0  # of it, after which the readings were not left behind
    least, lost = np.inf, 0  # of the rounds so far, and rounds since that fit worse than it
    losses: list[float] = []
    before, above_bar = np.inf, 0  # of the round before, and rounds in a row that are too slow to get below `bar`
    held, feigned = False, 0.0  # whether signs are, and how much worse a fit has looked since
    best: tuple[States, np.ndarray, np.ndarray, Levels, list[Parameter]] | None = None
    least_move, before_divergence = np.inf, best
    for k in range(rounds + len(anneal)):
        rough, newly, held = k < len(anneal), sign is not None and not held, sign is not None
        own = Fitted(states, tau, doubt, levels, numbers)
        linear = linear_at(track, own, fixed, placed, linear, sign, rough, surprise)
        if levels is None:
            tau = missing_at_first(track, linear)
            levels = first_levels(track, states, tau, noise)
            own = Fitted(states, tau, doubt, levels, numbers)
            linear = linear_at(track, own, fixed, placed, None, sign, rough)
        loud = anneal[k] if k < len(anneal) else 1.0
        begun_levels = levels = replace(levels, louder=np.where(track.late, loud, 1.0))
        stretch = stretches(track, tau) if stretch is None else stretch
        levels = adapted(track, linear, levels, tau, numbers, stretch, noise, pace)
        found = solve(track, linear, levels, tau, numbers, stretch, dispersion)
        if runs_away(found, taken and taken[1], count) and cut > LEAST_CUT:
            assert taken is not None
            cut /= 2
            own, last, at = taken
            shorter = replace(last, change=cut * last.change, step=cut * last.step)
            own = own.stepped(track, at, shorter, placed, k == 1)
            states, tau, doubt, levels, numbers = own.states, own.tau, own.doubt, own.levels, own.numbers
            fixed, linear = numbers or fixed, None
            continue
        if not np.isfinite(found.chi2):
            break
        dispersion, surprise = found.dispersion, found.surprise
        change, far = found.moves(linear, levels, track), found.farthest(numbers)
        if not np.isfinite(change + far):
            found = replace(found, chi2=np.inf)
            break
        if not rough and change <= least_move:
            least_move, before_divergence = change, (states, tau, doubt, levels, numbers)
        travels = any(n.log and abs(own) > 0.99 * np.log(TRUST) for n, own in zip(numbers, found.step, strict=True))
        if k > len(anneal) + 1 and not travels and max(change, far / FAR) > SHRINKS * last_step:
            # Signs of speeds within their doubt that flip back and forth: what friction is there, is in between.
            relax = 1.0 if sign is None else 0.5
            sign = (linear.plant.rubbing.sign + last_sign) / 2 if sign is None else sign
        last_step, last_sign = max(change, far / FAR), linear.plant.rubbing.sign
        found = replace(found, change=relax * found.change, step=relax * found.step)
        progress(
            f"smoothing: step {k + 1} of at most {rounds + len(anneal)}, readings move by {change:.2g} of their noise, "
            f"numbers by {far:.2g} of their sd"
        )
        now, moved = found.fit + found.cost, max(moved_by(levels, begun_levels), far) / FAR
        # A gear's damping, and what a law remembers of the last trajectory, creep: no likelier for it, it stands still.
        creeps = max(change, moved) < WORN and 2 * abs(now - before) < TIED
        converged = k >= len(anneal) and (max(change, moved) < STILL or creeps)
        if converged and track.long:
            # So small a step of the trajectory is not taken: where a joint sticks, it may lead to another branch.
            numbers = [number.moved(step) for number, step in zip(numbers, found.step, strict=True)]
            break
        assert levels is not None
        rested, cut = levels.rests, 1.0
        taken = Fitted(states, tau, doubt, levels, numbers), found, linear
        own = taken[0].stepped(track, linear, found, placed, k == 0)
        states, tau, doubt, levels, numbers = own.states, own.tau, own.doubt, own.levels, own.numbers
        assert levels is not None
        fixed = numbers or fixed
        converged &= k > 0 or np.array_equal(levels.rests, rested)  # else levels are those of other samples
        if converged:
            break
        # A fit that settles takes steps that shrink; one that travels may take as many more as there are.
        more = rounds + len(anneal) - 1 - k if travels else 1 / (1 - SHRINKS)
        feigned = max(now - before, 0.0) if newly else feigned
        slow = k > len(anneal) and now - feigned - bar > more * max(before - now, 0.0)
        before, above_bar = now, above_bar + 1 if slow else 0
        losses.append(now)
        if above_bar == ROUNDS_ABOVE_BAR:
            break
        if patience and k >= len(anneal):
            lost = lost + 1 if now > least + TIED else 0
            if now < least:
                least, best = now, (states, tau, doubt, levels, numbers)
            if lost == patience:
                break
        if change > WORN:
            linear = None
    diverged = not np.isfinite(found.chi2)
    converged = converged or (k == rounds + len(anneal) - 1 and is_ahead(losses[-rounds // 2 :], bar))
    if diverged:  # where it was nearly still before, what stands is how it was
        best, least = before_divergence, least_move
    if not converged and best is not None and np.isfinite(least):
        states, tau, doubt, levels, numbers = best
        fixed, linear, sign = numbers or fixed, None, None
    if not (converged and track.long):
        # Fits are compared with friction that stops what it holds: at held signs it is a force like any other.
        own = Fitted(states, tau, doubt, levels, numbers)
        linear = linear_at(track, own, fixed, placed, linear, None, False, surprise)
    assert linear is not None and levels is not None and stretch is not None
    if levels.rests.any() and not diverged:  # what has just come to rest, or left it, needs other levels
        for _ in range(2):
            levels = adapted(track, linear, levels, tau, numbers, stretch, noise, Pace())
    found = solve(track, linear, levels, tau, numbers, stretches(track, tau))
    if diverged and np.isfinite(found.chi2):
        change = found.moves(linear, levels, track)
        sound = change < WORN and found.chi2 < TRUST * count
        found = found if sound else replace(found, chi2=np.inf)
    fixed = numbers or fixed
    return Smoothed(
        track, placed_of(fixed, placed), tuple(priors), tuple(fixed), states, tau, doubt, found.surprise, levels,
        linear, found.filter, found.information, found.dispersion, found.chi2, found.fit, found.cost, count, converged,
        k + 1, float(change),
    )  # fmt: skip
