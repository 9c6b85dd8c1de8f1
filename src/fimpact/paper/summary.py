"""The tables behind docs/paper.md: one row per system and method, coverage per parameter, and the reduction curve."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from fimpact.paper.measures import BASELINE, DESIGNED, errors, final, information_ratio, once, reduction, touched

FAR = "far above the noise"  # as fimpact.paper.estimate says it, which this module does not load


def summarise(trials: pd.DataFrame, diagnostics: pd.DataFrame, reach: pd.DataFrame) -> pd.DataFrame:
    """One row per system and method: final error, reductions, information, contact, failures, estimator, time.

    Args:
        trials: a row per system, method, seed, round and parameter, as in `trials.csv`.
        diagnostics: a row per system, method, seed, round and parameter, as in `diagnostics.csv`.
        reach: a row per system and seed: did `fisher` find contact from a start without, as in `reach.csv`.
    """
    rows = []
    for system, part in trials.groupby("system", sort=False):
        checks = diagnostics[diagnostics.system == system]
        rows += [{"system": system, **row} for row in _methods(part, checks)]
    summary = pd.DataFrame(rows)
    free = reach[reach.start_contact_steps == 0].groupby("system")
    for name in ("reached", "reached_at_guess"):
        summary[name] = summary.system.map(free[name].mean()).where(summary.method == DESIGNED)
    return summary


def coverage(diagnostics: pd.DataFrame, trials: pd.DataFrame) -> pd.DataFrame:
    """Share of seeds whose final 95 % interval holds the truth, per system, method and parameter.

    A fit that stayed far above the noise claims no interval: it is `withheld`, and not among the `seeds`.
    """
    last = _claims(diagnostics, trials)
    last = last[last["round"] == last.groupby("system")["round"].transform("max")]
    groups = last.groupby(["system", "method", "parameter"], sort=False)
    table = groups.agg(
        covered=("claimed", "mean"),
        standard_error=("standard_error", "median"),
        seeds=("claimed", "count"),
        withheld=("withheld", "sum"),
    )
    return table.reset_index()


def _claims(diagnostics: pd.DataFrame, trials: pd.DataFrame) -> pd.DataFrame:
    keys = ["system", "method", "seed", "round"]
    status = trials.drop_duplicates(keys)[[*keys, "status"]]
    table = diagnostics.merge(status, on=keys, how="left", validate="many_to_one")
    withheld = (table.status == FAR) | table.status.str.startswith("failed").fillna(False)
    return table.assign(
        withheld=withheld.astype(int),
        claimed=table.covered.astype(float).mask(withheld),
        standard_error=table.standard_error.mask(withheld),
    )


def reduction_curve(sweep: pd.DataFrame) -> pd.DataFrame:
    """Per system and surface position: share of random experiments that touched, and the error reduction there."""
    rows = []
    for (system, surface), part in sweep.groupby(["system", "surface"]):
        error = final(errors(part))
        row = {"system": system, "surface": surface, "touched": touched(part[part.method == BASELINE])}
        row |= _interval("reduction", error, DESIGNED, BASELINE)
        row |= {f"error_{method}": error[method].median() for method in (DESIGNED, BASELINE)}
        rows.append(row | {"seeds": len(error)})
    return pd.DataFrame(rows)


def _methods(trials: pd.DataFrame, diagnostics: pd.DataFrame) -> Iterator[dict]:
    error = final(errors(trials))
    designed = diagnostics[diagnostics["round"] > 0]
    claims = _claims(designed[designed["round"] == trials["round"].max()], trials).groupby("method").claimed.mean()
    method: Any
    for method, rows in trials.groupby("method", sort=False):
        low, middle, high = error[method].quantile([0.25, 0.5, 0.75])
        seeds = int(error[method].count())
        yield {"method": method, "seeds": seeds, "final_error": middle, "error_q25": low, "error_q75": high} | (
            _interval("reduction", error, method, BASELINE)
            | _interval("fisher_reduction", error, DESIGNED, method)
            | _ratio(trials, method)
            | _counts(rows, trials["round"].max(), seeds)
            | {"coverage": claims.get(method, np.nan)}
            | {"candidates": designed[designed.method == method].candidates.median()}
        )


def _interval(name: str, error: pd.DataFrame, method: str, baseline: str) -> dict[str, float]:
    known = method in error and baseline in error
    values = reduction(error[method], error[baseline]) if known else (np.nan,) * 3
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def _ratio(trials: pd.DataFrame, method: str) -> dict[str, float]:
    known = BASELINE in set(trials.method)
    ratio = information_ratio(trials)[method] if known else pd.Series([np.nan])
    return {"information_ratio": ratio.median(), "information_ratio_min": ratio.min()}


def _counts(rows: pd.DataFrame, last: int, seeds: int) -> dict[str, float]:
    ended = once(rows[rows["round"] == last])
    return {
        "touched": touched(rows),
        "failed": rows[rows.status.str.startswith("failed")].seed.nunique(),
        "withheld": int((ended.status == FAR).sum()),
        "agreement": (ended.status == "converged").sum() / seeds,
        "seconds": once(rows).seconds.sum(),
    }


COLUMNS = {
    "system": lambda row: row.system,
    "method": lambda row: row.method,
    "final error (quartiles)": lambda row: _spread(row.final_error, row.error_q25, row.error_q75),
    "reduction against uniform": lambda row: _against(row, "reduction", BASELINE),
    "fisher's reduction against it": lambda row: _against(row, "fisher_reduction", DESIGNED),
    "information / uniform's (least seed)": lambda row: _gain(row),
    "touched": lambda row: percent(row.touched, 0),
    "starts agree": lambda row: percent(row.agreement, 0),
    "covered": lambda row: percent(row.coverage, 0),
    "withheld": lambda row: str(row.withheld),
    "failed": lambda row: f"{row.failed} of {row.seeds}",
    "time": lambda row: _duration(row.seconds),
}


def to_markdown(summary: pd.DataFrame) -> str:
    """The table of docs/paper.md, and below it how often `fisher` found contact from a start without."""
    rows = [list(COLUMNS), ["---"] * len(COLUMNS)]
    rows += [[write(row) for write in COLUMNS.values()] for row in summary.itertuples()]
    table = "\n".join("| " + " | ".join(row) + " |" for row in rows)
    reached = summary.dropna(subset="reached")
    shares = ", ".join(f"{row.system} {_reach(row)}" for row in reached.itertuples())
    return f"{table}\n" + (f"\nDesigns that reached contact from a contact-free start: {shares}.\n" if shares else "")


def _reach(row) -> str:
    return f"{percent(row.reached, 0)} on the truth ({percent(row.reached_at_guess, 0)} on the first guess)"


def coverage_to_markdown(table: pd.DataFrame, method: str = DESIGNED) -> str:
    """Coverage of the final 95 % intervals of one method, a line per parameter."""
    lines = ["| system | parameter | covered | median standard error | seeds | withheld |"]
    lines += ["|---|---|---|---|---|---|"]
    row: Any
    for row in table[table.method == method].itertuples():
        cells = (
            row.system,
            row.parameter,
            percent(row.covered, 0),
            percent(row.standard_error),
            str(row.seeds),
            str(row.withheld),
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def percent(share: float, digits: int | None = None) -> str:
    """A share as readable percent, a decimal more below 1 %; a dash if unknown."""
    digits = digits if digits is not None else 2 if 0 < abs(share) < 0.01 else 1
    return f"{100 * share:.{digits}f} %".replace("-", "−") if np.isfinite(share) else "–"


def _spread(middle: float, low: float, high: float) -> str:
    ends = f" ({percent(low)} to {percent(high)})" if np.isfinite([low, high]).all() else ""
    return percent(middle) + ends.replace(" % to", " to")


def _against(row, name: str, itself: str) -> str:
    return "–" if row.method == itself else _spread(*(getattr(row, name + end) for end in ("", "_low", "_high")))


def _gain(row) -> str:
    if row.method == BASELINE or np.isnan(row.information_ratio):
        return "–"
    return f"{times(row.information_ratio)} ({times(row.information_ratio_min)})"


def times(ratio: float) -> str:
    """A ratio as readable factor."""
    return "∞" if np.isinf(ratio) else f"{ratio:,.0f} ×" if 100 <= ratio < 1e6 else f"{ratio:.2g} ×"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"
