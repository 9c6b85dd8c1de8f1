"""Starts for the estimator: many prior draws, pulled towards the data through blurred likelihoods.

The likelihood of contact data is rugged: two impacts that differ by a few milliseconds do not overlap, so their
squared difference has no slope towards each other. Blurred in time, they do. The search fits the blurred and
tempered likelihood first, from many draws, and sharpens it stage by stage while it keeps the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fimpact.engine import mjx
from fimpact.programs import programs
from fimpact.systems.base import System
from fimpact.truth import Recording

MARGIN = 1e-3  # relative; starts stay this far inside the bounds, where the trust region can move
SILENT = 6.0  # standard deviations; no sample above it means no contact, and nothing to be pulled towards
SETTLED = 1e-4  # relative; a stage ends when no start has gained more in two iterations
STEP_LIMIT = 0.2  # relative; linearised contact is not to be trusted further


@dataclass(frozen=True)
class Campaign:
    """All that is known so far: the recordings, the initial guess rho (p,) and its relative prior deviation."""

    system: System
    model: mjx.Model
    recordings: tuple[Recording, ...]
    guess: np.ndarray
    prior_sd: float

    @property
    def designs(self) -> np.ndarray:
        """Inputs of every experiment, shape (r, d)."""
        return np.array([recording.design for recording in self.recordings])

    @property
    def measured(self) -> np.ndarray:
        """Whitened measurements, shape (r, T * ny)."""
        return np.array([r.measurement.ravel() for r in self.recordings]) / self.system.sensor.noise

    def clip(self, rho: np.ndarray) -> np.ndarray:
        """`rho` moved just inside the bounds."""
        low, high = self.system.bounds
        return np.clip(rho, low + MARGIN, high - MARGIN)


class Mode(NamedTuple):
    """An optimum, rho (p,), and a square root of its covariance, (p, p)."""

    rho: np.ndarray
    spread: np.ndarray


@dataclass(frozen=True)
class Stage:
    """Width of the blur in steps (0: none), variance factor, survivors kept, Levenberg-Marquardt iterations."""

    blur: float
    temper: float
    starts: int
    iterations: int


def search(
    campaign: Campaign, settings: dict, carried: Sequence[Mode], rng: np.random.Generator, effort: int = 1
) -> np.ndarray:
    """Starts in rising order of cost, shape (k, p).

    Args:
        carried: what earlier rounds found; never empty.
        effort: multiplies the number of draws and of starts.
    """
    timestep = campaign.system.settings["timestep"]
    stages = [
        Stage(s["blur"] / timestep, s["temper"], effort * s["starts"], s["iterations"]) for s in settings["stages"]
    ]
    pool = _draws(campaign, effort * settings["screen"], carried, rng)
    errors = _errors(campaign, pool)
    if np.abs(campaign.measured).max() < SILENT:
        return _best(campaign, pool, errors, stages[-1])
    found = pool[:0]
    for stage in stages:
        # Draws that already fit sharply enter late: a blurred fit would only lead them away.
        fresh = _best(campaign, pool, errors, stage)
        found, cost = _descend(campaign, np.vstack([found, fresh]), stage)
        found = found[np.argsort(cost, kind="stable")[: stage.starts]]
    return found


def _draws(campaign: Campaign, count: int, carried: Sequence[Mode], rng: np.random.Generator) -> np.ndarray:
    # Half of the draws explores what earlier rounds left open, along the directions they left it open; an
    # eighth stays near them; the rest never forgets the prior.
    modes = [carried[i % len(carried)] for i in range(5 * count // 8)]
    unit = rng.standard_normal((count, len(campaign.guess)))
    scale = np.tile([0.5, 1.0, 2.0, 4.0], count)
    laplace = [m.rho + scale[i] * m.spread @ unit[i] for i, m in enumerate(modes[: count // 2])]
    near = [m.rho + campaign.prior_sd / 3 * unit[count // 2 + i] for i, m in enumerate(modes[count // 2 :])]
    wide = campaign.guess + campaign.prior_sd * unit[len(modes) :]
    return campaign.clip(np.vstack([[campaign.guess], [m.rho for m in carried], laplace, near, wide]))


def _errors(campaign: Campaign, rho: np.ndarray) -> np.ndarray:
    """Predicted less measured, whitened, one row per rho and experiment: (n * r, T * ny)."""
    rows, designs = _pairs(campaign, rho)
    predicted = programs(campaign.system).predict(campaign.model, rows, designs).measurement
    return predicted - np.tile(campaign.measured, (len(rho), 1))


def _best(campaign: Campaign, pool: np.ndarray, errors: np.ndarray, stage: Stage) -> np.ndarray:
    squares = (_blurred(campaign, errors, stage).reshape(len(pool), -1) ** 2).sum(1) / 2
    cost = np.where(np.isfinite(squares), squares, np.inf) + _prior_cost(campaign, pool)
    return pool[np.argsort(cost, kind="stable")[: stage.starts]]


def _descend(campaign: Campaign, rho: np.ndarray, stage: Stage) -> tuple[np.ndarray, np.ndarray]:
    # Levenberg-Marquardt in lockstep: all starts share one batch, which costs as much as one start alone.
    damping, settled = np.full(len(rho), 1e-2), 0
    cost, gradient, hessian = _expand(campaign, rho, stage)
    for _ in range(stage.iterations):
        scaled = damping[:, None, None] * hessian * np.eye(rho.shape[1])
        step = np.linalg.solve(hessian + scaled, -gradient[..., None])[..., 0]
        trial = campaign.clip(rho + np.clip(step, -STEP_LIMIT, STEP_LIMIT))
        new_cost, new_gradient, new_hessian = _expand(campaign, trial, stage)
        better = new_cost < cost
        settled = settled + 1 if (cost - new_cost < SETTLED * (1 + cost)).all() else 0
        rho, cost = np.where(better[:, None], trial, rho), np.where(better, new_cost, cost)
        gradient = np.where(better[:, None], new_gradient, gradient)
        hessian = np.where(better[:, None, None], new_hessian, hessian)
        damping = np.where(better, damping / 5, np.minimum(damping * 4, 1e8))
        if settled == 2:
            break
    return rho, cost


def _expand(campaign: Campaign, rho: np.ndarray, stage: Stage) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cost (n,), gradient (n, p) and Gauss-Newton Hessian (n, p, p) of the stage's negative log posterior."""
    rows, designs = _pairs(campaign, rho)
    point = programs(campaign.system).linearise(campaign.model, rows, designs)
    count, p = rho.shape
    error = point.measurement - np.tile(campaign.measured, (count, 1))
    error = _blurred(campaign, error, stage).reshape(count, -1)
    slope = _blurred(campaign, point.sensitivity, stage).reshape(count, -1, p)
    valid = np.isfinite(slope).all((1, 2)) & np.isfinite(error).all(1)
    error, slope = np.where(valid[:, None], error, 0.0), np.where(valid[:, None, None], slope, 0.0)
    cost = np.where(valid, (error**2).sum(1) / 2, np.inf) + _prior_cost(campaign, rho)
    precision = campaign.prior_sd**-2
    gradient = np.einsum("nka,nk->na", slope, error) + (rho - campaign.guess) * precision
    return cost, gradient, np.einsum("nka,nkb->nab", slope, slope) + np.eye(p) * precision


def _pairs(campaign: Campaign, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.repeat(rho, len(campaign.recordings), 0), np.tile(campaign.designs, (len(rho), 1))


def _blurred(campaign: Campaign, rows: np.ndarray, stage: Stage) -> np.ndarray:
    """Gaussian blur along time of rows (n, T * ny, ...), scaled so that white noise keeps its variance."""
    if stage.blur > 0:
        steps = np.arange(campaign.system.steps)
        kernel = np.exp(-0.5 * ((steps[:, None] - steps) / stage.blur) ** 2)
        kernel /= np.sqrt((kernel**2).sum(1, keepdims=True))
        shaped = rows.reshape(len(rows), len(steps), -1)
        rows = np.matmul(kernel, shaped).reshape(rows.shape)
    return rows / np.sqrt(stage.temper)


def _prior_cost(campaign: Campaign, rho: np.ndarray) -> np.ndarray:
    return (((rho - campaign.guess) / campaign.prior_sd) ** 2).sum(1) / 2
