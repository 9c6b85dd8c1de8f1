"""What the benchmark shows: every line of the claim, with its 95 % interval, from `cases.csv` alone.

Proportions have Wilson intervals, medians percentile bootstraps over cases. A line without a case says so, and a bar
that is missed is called missed.
"""

import numpy as np
import pandas as pd

from fimpact.benchmark.grading.case_table import of_kinds
from fimpact.benchmark.grading.claim_costs import export_lines, time_lines
from fimpact.benchmark.grading.claim_lines import (
    RESAMPLES,
    ClaimLine,
    as_markdown,
    coverage,
    number,
    percent,
    share,
    with_interval,
)

VISIBLE = 30.0  # non-centrality from which an oracle sees an effect
WORTHWHILE = 0.02  # share of the naive held-out error that the oracle must remove for a share of it to mean anything
SURE = 0.5  # stated confidence above which a wrong name is confidently wrong
BINS = 10  # of stated confidence
SYSTEMS = {"arm_free": (0.94, 0.97), "arm_contact": (0.92, 0.95), "block": (0.96, 0.98)}
ROBOTS = {"six_axis": (0.92, 0.95), "six_servo": (0.88, 0.95), "leg": (0.85, 0.95)}
ODD = 0.05  # worth, as a share of the force at its place, from which an odd effect should be named
NULL, NONE, UNNAMED = "null", "none", "unnamed"


def measure(cases: pd.DataFrame) -> list[ClaimLine]:
    """Every line, in the order in which the claim makes them.

    Args:
        cases: a row per case, as `score` writes them.
    """
    return [line for part in PARTS for line in part(cases)]


def _detection(cases: pd.DataFrame) -> list[ClaimLine]:
    seen = cases[(cases.kind != "null") & (cases["lambda"] >= VISIBLE)]
    return [
        share("false alarms where nothing is missing", of_kinds(cases, "null").detected, -1, 0.03, 0.01),
        share("detected where λ ≥ 30, all kinds", seen.detected, 1, 0.97, 0.99),
        share("… single effects only", of_kinds(seen, "single").detected),
    ]


def _naming(cases: pd.DataFrame) -> list[ClaimLine]:
    found = of_kinds(cases, "single")[of_kinds(cases, "single").detected]
    limits = SYSTEMS | {name: own for name, own in ROBOTS.items() if name in set(cases.system)}
    lines = [
        share(f"best name right among the detected, {system}", found[found.system == system].right, 1, *own)
        for system, own in limits.items()
    ]
    size = found.answer_set.str.count(r"\|") + 1
    return [
        *lines,
        share("truth inside the answered set", found.in_set, 1, 0.97, 0.99),
        with_interval("size of the set, mean", size, np.mean, number(), -1, 2.0, 1.5),
    ]


def _confidence(cases: pd.DataFrame) -> list[ClaimLine]:
    stated = claims(cases)
    if stated.empty:
        return [ClaimLine("expected calibration error", np.nan, np.nan, np.nan, 0, -1, 0.08, 0.04, number(digits=3))]
    rng, pairs = np.random.default_rng(0), stated.to_numpy(float)
    drawn = [error_of(pairs[rng.integers(len(pairs), size=len(pairs))]) for _ in range(RESAMPLES // 4)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    value = error_of(pairs)
    return [
        ClaimLine("expected calibration error", value, low, high, len(pairs), -1, 0.08, 0.04, number(digits=3)),
        with_interval("… confidence stated, mean", stated.confidence, np.mean, percent),
        with_interval("… right, mean", stated.right, np.mean, percent),
    ]


def claims(cases: pd.DataFrame) -> pd.DataFrame:
    """Every answer that named something, with its stated confidence and whether it was right, in all kinds but crowds,
    whose names are judged one by one."""
    named = cases[cases.detected & (cases.answer != UNNAMED) & (cases.kind != "crowd")]
    return named[["confidence", "right"]].dropna().astype(float)


def calibration(stated: np.ndarray) -> np.ndarray:
    """Rows (mean confidence, share right, number) of each bin that is not empty; stated: (n, 2)."""
    place = np.minimum((stated[:, 0] * BINS).astype(int), BINS - 1)
    return np.array([[*stated[place == b].mean(0), (place == b).sum()] for b in np.unique(place)])


def error_of(stated: np.ndarray) -> float:
    """Expected calibration error of (confidence, right) pairs, (n, 2)."""
    table = calibration(stated)
    return float(np.sum(np.abs(table[:, 0] - table[:, 1]) * table[:, 2]) / len(stated))


def _location(cases: pd.DataFrame) -> list[ClaimLine]:
    found = of_kinds(cases, "single")[of_kinds(cases, "single").detected]
    return [
        share("right joint, contact pair, body or channel located", found.located, 1, 0.95, 0.98),
        share("… by the residual alone, before anything is named", found.place_right),
        share("right contact mode", found.mode_right, 1, 0.90, 0.95),
    ]


def recovered_share(cases: pd.DataFrame, after: str = "heldout_after") -> pd.Series:
    """Improvement as a share of the oracle's, where the oracle improves the held-out error by enough to compare."""
    possible = cases.heldout_before - cases.heldout_oracle
    enough = possible > WORTHWHILE * cases.heldout_before
    return ((cases.heldout_before - cases[after]) / possible)[enough]


def _improvement(cases: pd.DataFrame) -> list[ClaimLine]:
    planted = of_kinds(cases, "single", "double", "twin")
    held = planted.covered.dropna()
    return [
        with_interval(
            "held-out improvement, share of the oracle's, median",
            recovered_share(planted),
            np.median,
            percent,
            1,
            0.9,
            0.97,
        ),
        coverage("95 % intervals of the effect's parameters hold the truth", held, planted.intervals[held.index]),
    ]


def _several(cases: pd.DataFrame) -> list[ClaimLine]:
    pairs, outside = of_kinds(cases, "double"), of_kinds(cases, "outside")
    says = outside.answer_set.str.split("|").map(lambda names: UNNAMED in names).astype(bool)
    sure = outside.detected & ~says & (outside.confidence > SURE)
    return [
        share("two effects, both named", pairs.right, 1, 0.85, 0.92),
        share("… at least one of them", pairs.partly),
        share("outside the catalogue: said so", says, 1, 0.85, 0.92),
        share("… confidently wrong", sure, -1, 0.10, 0.03),
        share("… nothing said", ~outside.detected.astype(bool)),
    ]


def _crowds(cases: pd.DataFrame) -> list[ClaimLine]:
    """Nothing where there is no crowd."""
    crowds = of_kinds(cases, "crowd")
    if crowds.empty:
        return []
    far = crowds.heldout_after / crowds.heldout_oracle
    return [
        with_interval("crowd: precision of (kind, place)", crowds.precision, np.mean, percent, 1, 0.90, 0.97),
        with_interval("… recall of what an oracle tells from zero", crowds.recall, np.mean, percent, 1, 0.85, 0.95),
        with_interval("… sizes within 20 %", crowds.sizes_right, np.mean, percent),
        share("… odd effect worth 5 % of the force named", crowds.odd_named[crowds.worth >= ODD], 1, 0.70, 0.90),
        with_interval("… held-out error over the oracle's, median", far, np.median, number(" ×"), -1, 1.3, 1.1),
        share("outside the catalogue: said so, and where", _said_where(of_kinds(cases, "outside")), 1, 0.85, 0.92),
        *(
            share(f"false alarms where nothing is missing, {system}", own.detected, -1, 0.03, 0.01)
            for system, own in of_kinds(cases, NULL).groupby("system", sort=True)
        ),
    ]


def _said_where(outside: pd.DataFrame) -> pd.Series:
    says = outside.answer_set.str.split("|").map(lambda names: UNNAMED in names)
    return says[outside.located.notna()].astype(bool) & outside.located.dropna().astype(bool)


def _twins(cases: pd.DataFrame) -> list[ClaimLine]:
    twins, others = of_kinds(cases, "twin"), of_kinds(cases, "single", "double")
    both = twins.resolved_designed.notna() & twins.resolved_random.notna()
    gain = twins.resolved_designed[both].astype(float) - twins.resolved_random[both].astype(float)
    answered = twins.resolved_designed.astype("boolean").fillna(False).astype(bool)
    return [
        share("twins: the first answer is the set", twins.both_in_set, 1, 0.90, 0.97),
        share("… resolved rightly by one designed experiment, of all twins", answered, 1, np.nan, 0.85),
        share("… of those where an experiment was designed", twins.resolved_designed),
        share("… by one random experiment of the same limits", twins.resolved_random),
        with_interval("… designed over random, points", 100 * gain, np.mean, number(digits=0), 1, 20, np.nan),
        share("other sets: one designed experiment leaves the truth alone", others.resolved_designed),
        share("… one random experiment of the same limits", others.resolved_random),
    ]


PEERS = {
    "heldout_after": "fimpact",
    "heldout_sysid": "mujoco.sysid, single start",
    "heldout_sysid_five": "mujoco.sysid, best of five",
    "heldout_refit_all": "refit every candidate, BIC",
    "heldout_blackbox": "black-box residual",
}


def _peers(cases: pd.DataFrame) -> list[ClaimLine]:
    shared = cases[cases.heldout_blackbox.notna()]
    planted, refitted = of_kinds(shared, "single", "double", "twin"), shared[shared.answer_refit_all.notna()]
    lines = [
        with_interval(
            f"share of the oracle's improvement, {name}", recovered_share(planted, column), np.median, percent
        )
        for column, name in PEERS.items()
    ]
    single, nothing = of_kinds(refitted, "single"), of_kinds(refitted, NULL)
    return [
        *lines,
        share("best name right, all single effects that were refitted, fimpact", single.right),
        share("… refit every candidate, BIC", single.answer_refit_all == single.truth),
        share("false alarms in the same cases, fimpact", nothing.detected),
        share("… refit every candidate, BIC", nothing.answer_refit_all != NONE),
    ]


PARTS = (_detection, _naming, _confidence, _location, _improvement, _several, _crowds, _twins, export_lines, time_lines)


def to_markdown(cases: pd.DataFrame) -> str:
    """Both tables: what was demanded, and the comparators on the share of the cases that they ran on."""
    claim, peers = measure(cases), _peers(cases)
    counts = ", ".join(f"{n} {kind}" for kind, n in cases.kind.value_counts().sort_index().items())
    failed = int((cases.status != "done").sum())
    compared, refitted = (int(cases[column].notna().sum()) for column in ("heldout_blackbox", "answer_refit_all"))
    return (
        f"{len(cases)} cases: {counts}; {failed} failed and count as answered `none`.\n\n{as_markdown(claim)}\n\n"
        f"Comparators, on the same recordings: {compared} cases drawn at random, "
        f"every candidate refitted in {refitted} of them.\n\n"
        f"{as_markdown(peers)}\n"
    )


def to_table(cases: pd.DataFrame) -> pd.DataFrame:
    """The same as a table: what, value, low, high, n, bar, aim, reached."""
    lines = [*measure(cases), *_peers(cases)]
    keys = ("what", "value", "low", "high", "n", "bar", "aim")
    return pd.DataFrame([{k: getattr(m, k) for k in keys} | {"reached": m.verdict} for m in lines])
