"""Starts for the estimator: independent searches that anneal a blurred likelihood, and draws that already fit.

The likelihood of contact data is rugged: two impacts that differ by a few milliseconds do not overlap, so their
squared difference has no slope towards each other. Blurred in time, they do. A covariance-adapting search (CMA-ES)
goes down the blurred and tempered likelihood first and follows it while it is sharpened. It needs predictions
alone, which MuJoCo C makes, and no slope that a missed impact would hide.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from fimpact.paper.mjx.engine import mjx

import numpy as np
from cmaes import CMA

from fimpact.paper.forecast import forecaster
from fimpact.paper.reference_simulator import Recording
from fimpact.paper.systems.base import System

MARGIN = 1e-3  # relative; starts stay this far inside the bounds, where the trust region can move
SILENT = 6.0  # standard deviations; no sample above it means no contact, and nothing to be pulled towards
SETTLED = 1e-4  # relative; a stage ends when no start has gained more in two iterations
DIVERGED = 1e12  # cost of what cannot be simulated, in place of infinity, which CMA-ES does not take
NEAR = 0.03  # relative; least first deviation of a search around what was found
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


def prior_mode(campaign: Campaign) -> Mode:
    """What is known before the first experiment."""
    return Mode(campaign.guess, np.eye(len(campaign.guess)) * campaign.prior_sd)


def search(
    campaign: Campaign,
    settings: dict,
    carried: Sequence[Mode],
    rng: np.random.Generator,
    effort: int = 1,
    settled: bool = False,
) -> np.ndarray:
    """Starts in rising order of cost, shape (k, p): the best draws, and the best points of a search.

    Args:
        carried: what earlier rounds found, the prior before; never empty. The search goes on around the first.
        effort: multiplies the number of draws and the search's population; above 1 the search is from the prior.
        settled: what was carried fits already, so that draws are enough to contest it.
    """
    starts = settings["starts"]
    pool = _draws(campaign, effort * settings["screen"], carried, rng)
    pool = pool[np.argsort(posterior_cost(campaign, pool), kind="stable")]
    if np.abs(campaign.measured).max() < SILENT:
        return pool[:starts]
    groups = [pool[:starts]]
    if not settled:
        groups.append(_anneal(campaign, settings, prior_mode(campaign) if effort > 1 else carried[0], effort, rng))
    found, cost = _descend(campaign, np.vstack(groups), settings["iterations"])
    return found[np.argsort(cost, kind="stable")]


def _anneal(campaign: Campaign, settings: dict, mode: Mode, effort: int, rng: np.random.Generator) -> np.ndarray:
    """The best points of the last and sharpest stage of one search around `mode`, shape (starts, p)."""
    low, high = campaign.system.bounds
    size, seed = effort * settings["population"], int(rng.integers(2**31))
    wide = np.clip(4 * np.sqrt((mode.spread**2).sum(1).max()), NEAR, campaign.prior_sd)
    middle, deviation = (campaign.clip(mode.rho) - low) / (high - low), wide / (high - low).mean()
    cma = CMA(middle, deviation, bounds=np.tile([0.0, 1.0], (len(low), 1)), seed=seed, population_size=size)
    for stage in settings["stages"]:
        seen: list[tuple[float, np.ndarray]] = []
        for _ in range(stage["generations"]):
            points = np.array([cma.ask() for _ in range(size)])
            cost = posterior_cost(campaign, low + points * (high - low), stage["blur"], stage["temper"])
            cost = np.minimum(cost, DIVERGED)
            cma.tell(list(zip(points, cost, strict=True)))
            seen += zip(cost, low + points * (high - low), strict=True)
    seen.sort(key=lambda pair: pair[0])
    return campaign.clip(np.array([rho for _, rho in seen[: settings["starts"]]]))


def posterior_cost(campaign: Campaign, rho: np.ndarray, blur: float = 0.0, temper: float = 1.0) -> np.ndarray:
    """Negative log posterior of every rho (n, p), up to a constant, shape (n,); infinite where it diverges.

    Args:
        blur: width, s, of a blur in time of predicted less measured.
        temper: factor on the variance of the noise.
    """
    prior = (((rho - campaign.guess) / campaign.prior_sd) ** 2).sum(1) / 2
    if not campaign.recordings:
        return prior
    with np.errstate(over="ignore", invalid="ignore"):  # a draw that diverged
        errors = _blurred(campaign, whitened_errors(campaign, rho), blur)
        squares = (errors.reshape(len(rho), -1) ** 2).sum(1) / (2 * temper)
    return np.where(np.isfinite(squares), squares, np.inf) + prior


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


def whitened_errors(campaign: Campaign, rho: np.ndarray) -> np.ndarray:
    """Predict a campaign's errors: predicted less measured, whitened, one row per rho and experiment, (n r, T ny)."""
    rows, designs = _pairs(campaign, rho)
    predicted = forecaster(campaign.system).forecast(rows, designs).measurement
    return predicted - np.tile(campaign.measured, (len(rho), 1))


def _descend(campaign: Campaign, rho: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    # Levenberg-Marquardt in lockstep: all starts share one batch, which costs as much as one start alone.
    damping, settled = np.full(len(rho), 1e-2), 0
    cost, gradient, hessian = _expand(campaign, rho)
    for _ in range(iterations):
        scaled = damping[:, None, None] * hessian * np.eye(rho.shape[1])
        step = np.linalg.solve(hessian + scaled, -gradient[..., None])[..., 0]
        trial = campaign.clip(rho + np.clip(step, -STEP_LIMIT, STEP_LIMIT))
        new_cost, new_gradient, new_hessian = _expand(campaign, trial)
        better = new_cost < cost
        settled = settled + 1 if (cost - new_cost < SETTLED * (1 + cost)).all() else 0
        rho, cost = np.where(better[:, None], trial, rho), np.where(better, new_cost, cost)
        gradient = np.where(better[:, None], new_gradient, gradient)
        hessian = np.where(better[:, None, None], new_hessian, hessian)
        damping = np.where(better, damping / 5, np.minimum(damping * 4, 1e8))
        if settled == 2:
            break
    return rho, cost


def _expand(campaign: Campaign, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cost (n,), gradient (n, p) and Gauss-Newton Hessian (n, p, p) of the negative log posterior."""
    rows, designs = _pairs(campaign, rho)
    measurement, slope = forecaster(campaign.system).linearise(rows, designs)
    count, p = rho.shape
    error = (measurement - np.tile(campaign.measured, (count, 1))).reshape(count, -1)
    slope = slope.reshape(count, -1, p)
    valid = np.isfinite(slope).all((1, 2)) & np.isfinite(error).all(1)
    error, slope = np.where(valid[:, None], error, 0.0), np.where(valid[:, None, None], slope, 0.0)
    off, precision = rho - campaign.guess, campaign.prior_sd**-2
    with np.errstate(over="ignore", invalid="ignore"):
        cost = (error**2).sum(1) / 2 + (off**2).sum(1) * precision / 2
        gradient = np.einsum("nka,nk->na", slope, error) + off * precision
        hessian = np.einsum("nka,nkb->nab", slope, slope) + np.eye(p) * precision
    return np.where(valid & np.isfinite(cost), cost, np.inf), gradient, hessian


def _pairs(campaign: Campaign, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.repeat(rho, len(campaign.recordings), 0), np.tile(campaign.designs, (len(rho), 1))


def _blurred(campaign: Campaign, rows: np.ndarray, blur: float) -> np.ndarray:
    """Gaussian blur, `blur` s wide, along time of rows (n, T * ny), scaled so that white noise keeps its variance."""
    if blur == 0:
        return rows
    time = np.arange(campaign.system.steps) * campaign.system.settings["timestep"]
    kernel = np.exp(-0.5 * ((time[:, None] - time) / blur) ** 2)
    kernel /= np.sqrt((kernel**2).sum(1, keepdims=True))
    return np.matmul(kernel, rows.reshape(len(rows), len(time), -1)).reshape(rows.shape)
