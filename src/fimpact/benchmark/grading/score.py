"""Scoring: the seals are opened, and what was answered is held against what was planted.

One row per case. The first columns are the published ones; the rest say what the claim's other lines need.
"""

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import mujoco
import pandas as pd

from fimpact.benchmark.archive import load_recording
from fimpact.benchmark.grading.answers import NOTHING, amplitude, grade, listed, names_of, planted_name, size_of
from fimpact.benchmark.grading.oracle import oracle_error
from fimpact.benchmark.jsonl import Report, each, held_out_error, read_rows
from fimpact.benchmark.seal import open_seal
from fimpact.benchmark.site_equivalence import places
from fimpact.benchmark.truth import Truth
from fimpact.recordings import Recording

COLUMNS = (
    "case kind system planted site size kappa detected answer answer_set located heldout_before heldout_after "
    "heldout_oracle heldout_blackbox noise_floor seconds"
).split()
PEERS = (
    "heldout_sysid heldout_sysid_five heldout_refit_all answer_refit_all screening_seconds refit_all_seconds "
    "sysid_seconds blackbox_seconds"
).split()
STAGES = ("conceal", "diagnosis", "resolved", "peers")
SILENT: dict[str, Any] = {"answer": NOTHING, "answer_set": [NOTHING], "seconds": {}}


def score_case(
    case: str, truth: Truth, recording: Recording, told: dict[str, dict[str, Any]], oracle: bool = True
) -> dict[str, Any]:
    """One row of `cases.csv`.

    Args:
        told: rows about this case by stage: ``diagnosis``, and where there are any ``resolved`` and ``peers``.
        oracle: whether the oracle runs, as long as all of a diagnosis.
    """
    row = SILENT | told["diagnosis"]
    planted, answer, named = planted_name(truth.effects), listed(row["answer"]), names_of(row["answer"])
    held = row.get("held_out", {}).get("runs", [])
    model = mujoco.MjModel.from_xml_string(recording.xml)
    return {
        "case": case,
        "kind": truth.kind,
        "system": truth.system,
        "planted": planted,
        "site": truth.site,
        "size": ";".join(f"{size_of(effect):.6g}" for effect in truth.effects),
        "kappa": truth.kappa,
        "detected": row["answer"] != NOTHING,
        "answer": answer,
        "answer_set": "|".join(map(listed, row["answer_set"])),
        "located": _located(model, recording, truth, row, named),
        "heldout_before": held_out_error(held, "naive"),
        "heldout_after": held_out_error(held, "improved"),
        "heldout_oracle": oracle_error(recording, truth) if oracle and truth.effects else None,
        "heldout_blackbox": told.get("peers", {}).get("heldout_blackbox"),
        "noise_floor": 1.0 if held else None,
        "seconds": sum(row["seconds"].values()) or row.get("job_seconds"),
        "status": row["status"],
        "truth": planted,
        "rival": planted_name([truth.rival]) if truth.rival else None,
        "lambda": truth.lam,
        "kappa_unknown": truth.kappa_unknown,
        "confidence": row.get("confidence"),
        "p": row.get("p"),
        "left": row.get("remainder", {}).get("share"),
        "right": answer == planted,
        "partly": any(name in named for name in names_of(planted)),
        "in_set": planted in (answer, *map(listed, row["answer_set"])),
        **grade(truth, named, _sizes(row)),
        "odd": planted_name(truth.effects[-1:]) if truth.kind == "crowd" else None,
        "worth": truth.effects[-1].worth if truth.kind == "crowd" else None,
        **_where(model, recording, truth, row),
        **_held(truth, row),
        "exported": row.get("exported"),
        **_resolved(truth, row, told.get("resolved", {})),
        **{name: told.get("peers", {}).get(name) for name in PEERS},
        **{f"seconds_{stage}": seconds for stage, seconds in row["seconds"].items()},
        **{f"job_{stage}": told.get(stage, {}).get("job_seconds") for stage in STAGES},
    }


def _sizes(row) -> dict[str, float]:
    """The stated amplitude of every effect that is named."""
    values = {e["name"]: {c["name"]: c["value"] for c in e["coefficients"]} for e in row.get("effects", [])}
    return {name: amplitude(name.partition("@")[0], own) for name, own in values.items() if own}


def _located(model, recording: Recording, truth: Truth, row, named: list[str]) -> bool | None:
    """Whether the answer points at the right place: by the sites it names, or the residual where it names none."""
    wanted = [places(model, recording.channels, e.site) for e in truth.effects]
    if truth.kind == "crowd" or not wanted or not all(wanted):
        return None
    if named:
        got = set().union(*(places(model, recording.channels, name.split("@")[1]) for name in named))
    else:
        left = row.get("remainder", {})
        got = {_joint(left)} if left.get("follows") else _first_place(row)
    return all(bool(want & got) for want in wanted)


def _first_place(row) -> set[str]:
    """The joint where the naive model lacks the largest share of what is applied."""
    rows = row.get("missing_force", [])
    return {_joint(max(rows, key=lambda r: r["naive"] / max(r["applied"] or 0.0, 1e-12)))} if rows else set()


def _joint(row) -> str:
    return row["joint"].partition("[")[0]


def _where(model, recording: Recording, truth: Truth, row) -> dict[str, Any]:
    """What the missing force alone says before anything is named: its place; and the contact mode of the answer."""
    first, claimed = _first_place(row), row.get("acts_in")
    wanted = places(model, recording.channels, truth.effects[0].site) if truth.effects else set()
    listed = {_joint(own) for own in row.get("missing_force", [])}
    judged = truth.kind == "single" and bool(claimed) and truth.mode != "free"
    return {
        "place": next(iter(first), None),
        "place_right": bool(first & wanted) if wanted & listed and truth.kind == "single" else None,
        "mode": claimed,
        "mode_right": claimed == truth.mode if judged else None,
    }


def _held(truth: Truth, row) -> dict[str, int | None]:
    """Of the effect's intervals, how many there are and how many hold the planted value, where the name is right."""
    named = names_of(row["answer"])
    judged = [e for e in truth.effects if f"{e.name}@{e.site}" in named]
    if not judged or (truth.kind != "crowd" and listed(row["answer"]) != planted_name(truth.effects)):
        return {"intervals": None, "covered": None}
    stated = {(e["name"], c["name"]): (c["low"], c["high"]) for e in row["effects"] for c in e["coefficients"]}
    pairs = [
        (stated[f"{e.name}@{e.site}", name], value)
        for e in judged
        for name, value in e.values.items()
        if (f"{e.name}@{e.site}", name) in stated
    ]
    return {"intervals": len(pairs), "covered": sum(low <= value <= high for (low, high), value in pairs)}


def _resolved(truth: Truth, row, resolved) -> dict[str, Any]:
    """Whether a twin's first answer is the set, and after which experiment the answer is what was planted and its twin
    is not left or, where that has none, nothing else is."""
    out: dict[str, Any] = {"members": len(row["answer_set"]), "both_in_set": None}
    out |= {f"resolved_{way}": None for way in ("designed", "random")}
    if truth.kind in ("null", "outside", "crowd"):
        return out
    own, rival = planted_name(truth.effects), planted_name([truth.rival]) if truth.rival else None
    if rival:
        out["both_in_set"] = {own, rival} <= set(map(listed, row["answer_set"]))
    for way in {"designed", "random"} & set(resolved):
        left = [listed(name) for name in resolved[way]["answer_set"]]
        out[f"resolved_{way}"] = left[0] == own and (rival not in left if rival else len(left) == 1)
    return out


def score_part(
    recordings: Path, sealed: Path, told: dict[str, Path], compared: Collection[str], report: Report
) -> list[dict[str, Any]]:
    """Rows of `cases.csv` for one part; `told`: files of rows by stage; `compared`: cases on which the oracle runs.

    Raises:
        ValueError: a seal does not match the hash that lies beside its recording.
    """
    rows = {stage: read_rows(path) for stage, path in told.items()}

    def work(case: str) -> dict[str, Any]:
        truth, known = open_seal(sealed, recordings, case), {s: r[case] for s, r in rows.items() if case in r}
        return score_case(case, truth, load_recording(recordings, case), known, case in compared)

    return list(each(sorted(rows["diagnosis"]), work, report, strict=True))


def gather(parts: Iterable[str | Path]) -> pd.DataFrame:
    """Rows of all parts as one table, the published columns first, sorted by case."""
    table = pd.DataFrame([row for part in parts for row in read_rows(part).values()])
    # The first case need not have been through every stage: in its order, tables of other parts would differ.
    timed = sorted(name for name in map(str, table) if name.startswith("seconds_"))
    rest = [name for name in table if name not in (*COLUMNS, *timed, "job_seconds")] + timed
    table = table.rename(columns={"job_seconds": "job_score"})
    return table[[*COLUMNS, *rest, "job_score"]].sort_values("case", ignore_index=True)
