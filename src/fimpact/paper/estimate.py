"""Maximum likelihood with bounds and prior, from several starts, with covariance, agreement and a status.

scipy's trust-region reflective least squares does the work: it takes bounds and our Jacobian and stops with a reason.
(optimistix has no bounds, and a compiled solver would cost a minute of compilation.) Starts are fitted in MuJoCo C; the
best of these fits ends in MJX, with exact forward-mode sensitivities.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from fimpact.paper.forecast import forecaster
from fimpact.paper.information.programs import programs
from fimpact.paper.search import Campaign, Mode, posterior_cost, prior_mode, search

SAME_OPTIMUM = 2.0  # difference in log-likelihood below which two starts count as agreeing
FAR = "far above the noise"  # status of a fit that cannot be right: its estimate and interval claim nothing
NARROW = 0.1  # relative standard deviation below which draws of the posterior are as good as the estimate
LAST = 3  # exact evaluations, at most, of a fit that has converged but for the error of its differences
RESAMPLED = 32  # draws of the Laplace approximation for every draw of the posterior


@dataclass(frozen=True)
class Estimate:
    """Relative estimate rho (p,), its covariance (p, p), half the sum of squared whitened residuals, the share
    of starts that agree, the optima carried to the next round, and a status that is a value."""

    rho: np.ndarray
    covariance: np.ndarray
    cost: float
    agreement: float
    carried: list[Mode]
    status: str


def untried(campaign: Campaign) -> Estimate:
    """What is believed before the first experiment: the guess and its prior."""
    first = prior_mode(campaign)
    return Estimate(campaign.guess, first.spread**2, 0.0, 1.0, [first], "prior")


def estimate(campaign: Campaign, settings: dict, carried: list[Mode], rng: np.random.Generator) -> Estimate:
    """The estimate from all recordings of `campaign`.

    What earlier rounds found is fitted first. If that does not explain the new recording, a search goes on around it;
    if that does not come down to the noise either, the optimum is a wrong one and the search is repeated from the
    prior with twice the draws and population, at most `settings["retries"]` times. No truth is used in that.
    """
    fits = _fit(campaign, [mode.rho for mode in carried[:1]], settings)
    for attempt in range(settings["retries"] + 1):
        settled = bool(fits) and _at_noise(campaign, fits[0])
        first, *others = search(campaign, settings, carried, rng, 2**attempt, settled)[: settings["polish"]]
        fits = sorted(fits + _fit(campaign, [first], settings), key=_cost)
        if attempt == settings["retries"] or (fits and _at_noise(campaign, fits[0])):
            fits = sorted(fits + _fit(campaign, others, settings), key=_cost)[: settings["polish"]]
            break
    if not fits:
        nothing = np.full((len(campaign.guess),) * 2, np.nan)
        return Estimate(campaign.guess * np.nan, nothing, np.inf, 0.0, carried, "failed: no start could be simulated")
    exact = _polish(campaign, fits[0].x, {**settings, "evaluations": LAST}, _exactly)
    return _conclude(campaign, fits if exact is None else [exact, *fits[1:]])


def beliefs(campaign: Campaign, found: Estimate, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws of what is believed after `found`, shape (k, p) with k at most `count`; no truth is used.

    Draws around the estimate are resampled by what the recordings say to them: after silent experiments those stay
    that would have been silent. A narrow posterior is its estimate alone; a fit far above the noise is not believed,
    and the prior is.
    """
    mode = prior_mode(campaign) if found.status == FAR else found.carried[0]
    if np.sqrt((mode.spread**2).sum(1).max()) < NARROW:
        return mode.rho[None]
    half = rng.standard_normal((RESAMPLED * count // 2, len(mode.rho)))
    unit = np.stack([half, -half], 1).reshape(-1, len(mode.rho))  # in pairs around the mode: few draws, but balanced
    draws = campaign.clip(mode.rho + unit @ mode.spread.T)
    if found.status == FAR or not campaign.recordings:
        return draws[:count]
    draws, unit = np.vstack([draws, mode.rho]), np.vstack([unit, 0 * unit[0]])  # and the mode itself
    weight = (unit**2).sum(1) / 2 - posterior_cost(campaign, draws)
    weight = np.exp(weight - weight.max())
    return draws[np.unique(rng.choice(len(draws), count, p=weight / weight.sum()))]


def _conclude(campaign: Campaign, fits: list[OptimizeResult]) -> Estimate:
    best, carried = fits[0], [mode_of(fit) for fit in fits]
    agreeing = [fit.cost - best.cost < SAME_OPTIMUM for fit in fits]
    status = "converged" if sum(agreeing) >= 2 else "few starts agree"
    covariance = carried[0].spread @ carried[0].spread.T
    if not _at_noise(campaign, best):
        status, carried = FAR, [*carried, prior_mode(campaign)]
    return Estimate(best.x, covariance, float(best.cost), float(np.mean(agreeing)), carried, status)


def _fit(campaign: Campaign, starts: Sequence[np.ndarray], settings: dict) -> list[OptimizeResult]:
    return [fit for fit in (_polish(campaign, start, settings) for start in starts) if fit is not None]


def mode_of(fit: OptimizeResult) -> Mode:
    """Approximate the posterior around a fit by a normal distribution, that of the Fisher information there."""
    precision = fit.jac.T @ fit.jac
    try:
        return Mode(fit.x, np.linalg.cholesky(np.linalg.inv(precision)))
    except np.linalg.LinAlgError:  # so much information in one direction that round-off hides another
        values, vectors = np.linalg.eigh(precision)
        return Mode(fit.x, vectors / np.sqrt(np.maximum(values, values[-1] * np.finfo(float).eps)))


def _exactly(campaign: Campaign, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measurements of all experiments and their derivatives, by MJX."""
    return programs(campaign.system).linearise(campaign.model, rho, campaign.designs)


def _quickly(campaign: Campaign, rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same by MuJoCo C and differences."""
    return forecaster(campaign.system).linearise(np.tile(rho, (len(campaign.recordings), 1)), campaign.designs)


def _polish(campaign: Campaign, start: np.ndarray, settings: dict, linearise=_quickly) -> OptimizeResult | None:
    last: dict[bytes, tuple] = {}  # residual and slope of a point are asked one after the other

    def at(rho: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if rho.tobytes() not in last:
            last.clear()
            last[rho.tobytes()] = linearise(campaign, rho)
        return last[rho.tobytes()]

    def residual(rho: np.ndarray) -> np.ndarray:
        return np.append(at(rho)[0] - campaign.measured, (rho - campaign.guess) / campaign.prior_sd)

    def jacobian(rho: np.ndarray) -> np.ndarray:
        return np.vstack([at(rho)[1].reshape(-1, len(rho)), np.eye(len(rho)) / campaign.prior_sd])

    try:
        fit = least_squares(
            residual,
            start,
            jacobian,
            bounds=campaign.system.bounds,
            max_nfev=settings["evaluations"],
            xtol=1e-7,
            ftol=1e-7,
        )
    except ValueError:  # scipy refuses a residual that is not finite: this start cannot be simulated
        return None
    return fit if np.isfinite(np.asarray(fit.jac)).all() else None


def _cost(fit: OptimizeResult) -> float:
    return fit.cost


def _at_noise(campaign: Campaign, fit: OptimizeResult) -> bool:
    # Half a chi-squared of all measurements, and three of its standard deviations more.
    count = campaign.measured.size
    return bool(fit.cost < count / 2 + 3 * np.sqrt(count / 2))
