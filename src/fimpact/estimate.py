"""Maximum likelihood with bounds and prior, from several starts, with covariance, agreement and a status.

scipy's trust-region reflective least squares does the work: it takes bounds and our exact forward-mode Jacobian
and stops with a reason. (optimistix has no bounds, and a compiled solver would cost a minute of compilation.)
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from fimpact.programs import programs
from fimpact.search import Campaign, Mode, search

SAME_OPTIMUM = 2.0  # difference in log-likelihood below which two starts count as agreeing


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


def estimate(campaign: Campaign, settings: dict, carried: list[Mode], rng: np.random.Generator) -> Estimate:
    """The estimate from all recordings of `campaign`.

    A fit whose residual is far above the noise is a wrong optimum; the search is then repeated with twice the
    draws, also around what was found, at most `settings["retries"]` times. No truth is used in that.
    """
    for attempt in range(settings["retries"] + 1):
        starts = search(campaign, settings, carried, rng, 2**attempt)[: settings["polish"]]
        fits = [fit for fit in (_polish(campaign, start, settings) for start in starts) if fit is not None]
        if not fits:
            break
        fits.sort(key=lambda fit: fit.cost)
        carried = [_mode(fit) for fit in fits]
        if fits[0].cost < _noise_floor(campaign):
            break
    if not fits:
        nothing = np.full((len(campaign.guess),) * 2, np.nan)
        return Estimate(campaign.guess * np.nan, nothing, np.inf, 0.0, carried, "failed: no start could be simulated")
    return _conclude(fits, carried)


def _conclude(fits: list[OptimizeResult], carried: list[Mode]) -> Estimate:
    best = fits[0]
    agreeing = [fit.cost - best.cost < SAME_OPTIMUM for fit in fits]
    status = "converged" if sum(agreeing) >= 2 else "few starts agree"
    covariance = carried[0].spread @ carried[0].spread.T
    return Estimate(best.x, covariance, float(best.cost), float(np.mean(agreeing)), carried, status)


def _mode(fit: OptimizeResult) -> Mode:
    precision = fit.jac.T @ fit.jac
    try:
        return Mode(fit.x, np.linalg.cholesky(np.linalg.inv(precision)))
    except np.linalg.LinAlgError:  # so much information in one direction that round-off hides another
        values, vectors = np.linalg.eigh(precision)
        return Mode(fit.x, vectors / np.sqrt(np.maximum(values, values[-1] * np.finfo(float).eps)))


def _polish(campaign: Campaign, start: np.ndarray, settings: dict) -> OptimizeResult | None:
    compiled = programs(campaign.system)

    def residual(rho: np.ndarray) -> np.ndarray:
        predicted = compiled.predict(campaign.model, rho, campaign.designs).measurement
        return np.append(predicted - campaign.measured, (rho - campaign.guess) / campaign.prior_sd)

    def jacobian(rho: np.ndarray) -> np.ndarray:
        slope = compiled.linearise(campaign.model, rho, campaign.designs).sensitivity
        return np.vstack([slope.reshape(-1, len(rho)), np.eye(len(rho)) / campaign.prior_sd])

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
    return fit if np.isfinite(fit.jac).all() else None


def _noise_floor(campaign: Campaign) -> float:
    # Half a chi-squared of all measurements, plus five of its standard deviations.
    count = campaign.measured.size
    return count / 2 + 5 * np.sqrt(count / 2)
