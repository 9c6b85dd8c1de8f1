"""Six ways to choose the next experiment, under the same bounds and horizon.

`fisher` is contact-implicit: no contact schedule is given. It starts from spread draws and searches around the
best with a covariance-adapting strategy (CMA-ES); gradients refine what it found. If none of the
draws touches, information is flat, and the same strategy first closes the gap to the surface.

What optimises does so for what is believed, not for one guess: the criterion is its mean over a few draws of the
posterior. A design that only works if the estimate is right teaches nothing when it is wrong. While the posterior is
that wide, gradients are left out: the search is the better use of the time.

`contact_implicit` is the paper's own way: direct transcription with complementarity, for the trace of information at
the estimate (`fimpact.paper.contact_implicit`).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from cmaes import CMA

from fimpact.paper.contact_implicit.plan import Plan, planner
from fimpact.paper.forecast import forecaster
from fimpact.paper.information.fisher import CRITERIA
from fimpact.paper.task import Design, Task

POPULATION = 16
TOLD = 1e-3  # gain in a (logarithmic) criterion above which a candidate is taken to have touched
AFAR = 0.25  # first step of an approach, as a share of the range
NUDGE = 1e-4  # share of the range by which a gradient's differences are taken
STEPS = 0.5 ** np.arange(4, 12)  # of a search along a gradient, in shares of the inputs' range; one batch


def fisher(task: Task, blind: bool = False, start: np.ndarray | None = None) -> Design:
    """Maximise the criterion of the accumulated information through contact.

    Args:
        blind: believe that contact does not exist and look at the motion instead.
        start: initial candidates (n, d); uniform draws if not given.
    """
    candidates = start if start is not None else _draws(task, task.budget["spread"])
    values = evaluate(task, candidates, blind)
    if blind and not touches(task, values):  # flight tells a blind designer nothing: all throws are alike
        return Design(candidates[0], float(values[0]), len(candidates))
    clear = not (blind or touches(task, values))
    best = approach(task, candidates) if clear else candidates[np.argmax(values)]
    best, value = _search(task, best, blind)
    design, value = _refine(task, best, value, blind)
    return Design(design, value, _allowance(task, clear))


def touches(task: Task, values: np.ndarray) -> bool:
    """Tell whether any of the designs of these values, (n,), touches for what is believed."""
    return bool(values.max() > _nothing(task) + TOLD)


def _allowance(task: Task, clear: bool) -> int:
    """Candidates that a search may simulate; more of them if it has to approach the surface first."""
    budget, inputs = task.budget, len(task.system.inputs.bounds[0])
    # A gradient simulates a candidate per design variable.
    refining = budget["gradients"] * (inputs + len(STEPS)) if len(task.beliefs) == 1 else 0
    approaching = budget["spread"] + POPULATION * budget["approach"] if clear else 0
    return 1 + budget["spread"] + POPULATION * budget["generations"] + refining + approaching


def approach(task: Task, candidates: np.ndarray) -> np.ndarray:
    """Search inputs that bring every belief as near to the surface as the budget finds, shape (d,)."""
    shares = _gap_left(task, candidates)
    cma = _cma(task, candidates[np.argmin(shares)], AFAR)
    best, least = candidates[np.argmin(shares)], shares.min()
    for _ in range(task.budget["approach"]):
        points = _ask(task, cma)
        shares = _gap_left(task, points)
        _tell(task, cma, points, -shares)
        if shares.min() < least:
            best, least = points[np.argmin(shares)], shares.min()
    return best


def _gap_left(task: Task, candidates: np.ndarray) -> np.ndarray:
    """Share of the starting gap that is left at the closest, mean over the beliefs, shape (n,); 0 if all touch.

    It has a slope where information has none, and needs no sensitivities.
    """
    rows = np.tile(task.beliefs, (len(candidates), 1))
    seen = forecaster(task.system).forecast(rows, np.repeat(candidates, len(task.beliefs), 0))
    share = np.where(seen.first > 0, np.maximum(seen.closest, 0) / np.where(seen.first > 0, seen.first, 1), 0)
    return np.where(np.isfinite(share), share, 1).reshape(len(candidates), -1).mean(1)


def _search(task: Task, start: np.ndarray, blind: bool) -> tuple[np.ndarray, float]:
    best, best_value = start, evaluate(task, start[None], blind)[0]
    cma = _cma(task, start, task.budget["sigma"])
    for _ in range(task.budget["generations"]):
        points = _ask(task, cma)
        values = evaluate(task, points, blind)
        _tell(task, cma, points, values)
        if values.max() > best_value:
            best, best_value = points[np.argmax(values)], values.max()
    return best, float(best_value)


def _cma(task: Task, start: np.ndarray, sigma: float) -> CMA:
    low, high = task.system.inputs.bounds
    unit, seed = np.tile([0.0, 1.0], (len(low), 1)), int(task.rng.integers(2**31))
    return CMA((start - low) / (high - low), sigma, bounds=unit, seed=seed, population_size=POPULATION)


def _ask(task: Task, cma: CMA) -> np.ndarray:
    low, high = task.system.inputs.bounds
    return low + np.array([cma.ask() for _ in range(POPULATION)]) * (high - low)


def _tell(task: Task, cma: CMA, points: np.ndarray, values: np.ndarray) -> None:
    low, high = task.system.inputs.bounds
    cma.tell([((point - low) / (high - low), -value) for point, value in zip(points, values, strict=True)])


def _refine(task: Task, best: np.ndarray, value: float, blind: bool) -> tuple[np.ndarray, float]:
    # Contact bends the criterion within a hundredth of the range, so every gradient is followed in a batch of
    # steps of all sizes; a quasi-Newton method would spend its gradients on backtracking.
    low, high = task.system.inputs.bounds
    sure = len(task.beliefs) == 1  # a gradient for every belief would cost more than the whole search
    for _ in range(task.budget["gradients"] if sure else 0):
        nudges = best + NUDGE * np.diag(np.where(best > (low + high) / 2, low - high, high - low))
        slope = (evaluate(task, nudges, blind) - value) / np.diag(nudges - best) * (high - low)
        if not (np.isfinite(slope).all() and slope.any()):
            break
        line = best + STEPS[:, None] * slope / np.linalg.norm(slope) * (high - low)
        values = evaluate(task, line.clip(low, high), blind)
        if values.max() <= value:
            break
        best, value = line.clip(low, high)[np.argmax(values)], float(values.max())
    return best, value


def _draws(task: Task, count: int) -> np.ndarray:
    low, high = task.system.inputs.bounds
    return task.rng.uniform(low, high, (count, len(low)))


def evaluate(task: Task, candidates: np.ndarray, blind: bool = False) -> np.ndarray:
    """Criterion of the accumulated information for `candidates` (n, d), its mean over the beliefs: shape (n,).

    Where a belief cannot be simulated, the candidate is worth less than nothing learnt.
    """
    rows = np.tile(task.beliefs, (len(candidates), 1))
    slopes = forecaster(task.system).linearise(rows, np.repeat(candidates, len(task.beliefs), 0), blind)[1]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        information = task.known + slopes.transpose(0, 2, 1) @ slopes
        valid = np.isfinite(information).all((1, 2))
        values = CRITERIA[task.budget["criterion"]](np.where(valid[:, None, None], information, task.known))
    values = np.where(valid & np.isfinite(values), values, _nothing(task) - 1)
    return values.reshape(len(candidates), -1).mean(1)


def _nothing(task: Task) -> float:
    """Value of an experiment that tells nothing."""
    return float(CRITERIA[task.budget["criterion"]](task.known))


def contact_blind(task: Task) -> Design:
    """The same optimiser with contact removed from its model."""
    return fisher(task, blind=True)


def uniform(task: Task) -> Design:
    """Every knot of every input drawn uniformly within its bounds: the paper's baseline."""
    return Design(task.rng.uniform(*task.system.inputs.bounds), np.nan, 0)


def best_of_n(task: Task) -> Design:
    """The best, by the same criterion and beliefs, of as many uniform draws as `fisher` may simulate."""
    draws = _draws(task, task.budget["spread"])
    values = evaluate(task, draws)
    more = _draws(task, _allowance(task, not touches(task, values)) - len(draws))
    draws, values = np.vstack([draws, more]), np.append(values, evaluate(task, more))
    return Design(draws[np.argmax(values)], float(values.max()), len(draws))


def multisine(task: Task) -> Design:
    """Sum of three harmonics with random phases per input; a throw, having no time, follows it over rounds."""
    inputs = task.system.inputs
    count = inputs.knots if inputs.knots > 1 else task.rounds
    phases = task.rng.uniform(0, 2 * np.pi, (3, len(inputs.names)))
    time = np.arange(count)[:, None, None] / count
    waves = np.sin(2 * np.pi * np.arange(1, 4)[None, :, None] * time + phases).sum(1)
    waves /= np.abs(waves).max(0)
    rows = waves if inputs.knots > 1 else waves[task.round][None]
    return Design(((inputs.low + inputs.high) / 2 + rows * (inputs.high - inputs.low) / 2).ravel(), np.nan, 0)


def contact_implicit(task: Task, start: np.ndarray | None = None) -> Design:
    """The paper's direct transcription: the most information at the estimate, through rigid contact.

    Of the designs on the way, from contact felt from afar to rigid contact, that is taken which tells most where
    contact is soft: rigid contact is infinitely telling where it is grazed, and soft contact is not.

    Args:
        start: initial design (d,); a uniform draw if not given.
    """
    found = transcribe(task, start)
    values = evaluate(task, found.designs)
    return Design(found.designs[np.argmax(values)], float(values.max()), found.iterations + len(values))


def unknown_directions(known: np.ndarray) -> np.ndarray:
    """Scale the principal directions of the relative parameters, (p, p) by columns, by what is not known along them.

    Args:
        known: Fisher information with the prior, (p, p).
    """
    values, vectors = np.linalg.eigh(known)
    return vectors * np.sqrt(values.min() / values)


def transcribe(task: Task, start: np.ndarray | None = None) -> Plan:
    """The plan behind `contact_implicit`, from `start` (d,) or from uniform draws.

    Parameters are counted in units of what is not known of them yet, so that the trace does not ask for the same
    direction round by round; before the first experiment that is the paper's trace. A plan that does not touch when it
    is played on its own robot, whose contact is soft, may be of one that cannot; then what else is believed is tried in
    turn, from other starts, and the most telling plan taken.
    """
    tries = 1 + len(task.beliefs)
    starts = _draws(task, tries) if start is None else np.tile(start, (tries, 1))
    estimate = task.estimate if task.estimate is not None else task.beliefs.mean(0)
    settings, plans = task.budget["transcription"], []
    made, units, values = planner(task.system, settings["intervals"]), unknown_directions(task.known), []
    for rho, first in zip([estimate, *task.beliefs], starts, strict=True):
        plans.append(made.plan(rho, first, settings["eps"], settings["iterations"], units))
        values.append(evaluate(replace(task, beliefs=rho[None]), plans[-1].designs))
        if touches(task, values[-1]):
            break
    best = plans[np.argmax([value.max() for value in values])]
    return replace(best, iterations=sum(plan.iterations for plan in plans))


METHODS: dict[str, Callable[[Task], Design]] = {
    "fisher": fisher,
    "uniform": uniform,
    "contact_blind": contact_blind,
    "best_of_n": best_of_n,
    "multisine": multisine,
    "contact_implicit": contact_implicit,
}
