"""What a finished campaign is worth, seed by seed: errors, information, contact, and the paired reduction.

Every interval is a percentile bootstrap over seeds. BCa is not used: its acceleration comes from the jackknife, which
is inconsistent for medians, and it is undefined where seeds tie. The percentile interval has neither trouble, and
it is the same whether the ratio or the reduction is resampled.
"""

import numpy as np
import pandas as pd
from scipy.stats import bootstrap

DESIGNED, BASELINE = "fisher", "uniform"
CAMPAIGN = ["method", "seed"]
ROUND_OFF = 1e-9  # a prior of 30 % is worth 11 per parameter; without contact, round-off leaves some 1e-25
CONFIDENCE, RESAMPLES = 0.95, 9999
NOTHING = 1e-9  # information that a sensor which never fired seems to give, by rounding; the prior's is above 1


def errors(trials: pd.DataFrame) -> pd.DataFrame:
    """Root-mean-square relative parameter error in one system; rows (method, seed), columns rounds.

    A failed or missing round keeps the error of the last valid estimate, at worst that of the initial guess.
    """
    squares = (trials.relative_error**2).groupby([trials[key] for key in [*CAMPAIGN, "round"]])
    return _forward(np.sqrt(squares.mean(skipna=False)), "a valid initial guess in round 0")


def information(trials: pd.DataFrame) -> pd.DataFrame:
    """Trace of the accumulated information in one system; rows (method, seed), columns rounds; forward as `errors`."""
    trace = trials.groupby([*CAMPAIGN, "round"]).information_trace.first()
    return _forward(trace.mask(trace < NOTHING, 0.0), "information in round 0")


def final(table: pd.DataFrame) -> pd.DataFrame:
    """Last round of `errors` or `information`; rows seeds, columns methods; NaN where a method did not run on a seed.

    Raises:
        ValueError: a method that all others are compared with lacks a seed, so that the comparison cannot be paired.
    """
    last = table.iloc[:, -1].unstack("method")
    for method in last.columns.intersection([DESIGNED, BASELINE]):
        missing = list(last.index[last[method].isna()])
        if missing:
            raise ValueError(
                f"method '{method}' has no rows for seeds {missing}; others, which have, are compared with it: run it"
            )
    return last


def reduction(error: pd.Series, baseline: pd.Series) -> tuple[float, float, float]:
    """1 - median(error) / median(baseline), and its 95 % bootstrap interval paired by seed.

    Args:
        error, baseline: final errors, shape (seeds,), in the same order of seeds; those that lack either are left out.
    """
    pair = np.array([error, baseline], float)
    pair = pair[:, np.isfinite(pair).all(0)]

    def statistic(a, b, axis=-1):
        return 1 - np.median(a, axis=axis) / np.median(b, axis=axis)

    if pair.shape[1] < 2:
        return float(statistic(*pair)), np.nan, np.nan
    interval = bootstrap(
        tuple(pair),
        statistic,
        paired=True,
        confidence_level=CONFIDENCE,
        n_resamples=RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(statistic(*pair)), float(interval.low), float(interval.high)


def touched(trials: pd.DataFrame) -> float:
    """Share of the experiments that were run in which there was contact."""
    experiments = once(trials[trials["round"] > 0]).contact_steps.dropna()
    return float((experiments > 0).mean())


def information_ratio(trials: pd.DataFrame) -> pd.DataFrame:
    """Final accumulated information of every method over that of uniform; rows seeds, columns methods.

    Random experiments that never touch tell nothing: any information is then infinitely more, and none is as much.
    """
    gain = final(information(trials))
    with np.errstate(divide="ignore", invalid="ignore"):
        return gain.div(gain[BASELINE], axis=0).fillna(1.0).where(gain.notna())


def once(trials: pd.DataFrame) -> pd.DataFrame:
    """One row per experiment: its seconds and contact steps are repeated on the row of every parameter."""
    return trials.drop_duplicates([*CAMPAIGN, "round"])


def _forward(series: pd.Series, needed: str) -> pd.DataFrame:
    table = series.unstack("round").sort_index(axis=1).ffill(axis=1)
    if table.isna().any(axis=None):
        method, seed = table.index[table.isna().any(axis=1)][0]
        raise ValueError(f"method '{method}', seed {seed}: no value to start from; trials need {needed}")
    return table
