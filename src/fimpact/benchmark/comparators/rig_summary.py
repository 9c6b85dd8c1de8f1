"""Summary of the recordings: a row per rig and held-out run, what was found, and our errors beside those of others."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ERRORS = {
    "error_naive": "naive fit",
    "error_freed": "everything freed",
    "error_blackbox": "black box",
    "error_improved": "improved",
    "noise_floor": "noise floor",
}
COLUMNS = ("rig", "run", "verdict", "certain", "possible", *ERRORS, "unit", "seconds", "quanta", "converged")
OF_PEERS = {"sysid_freed": "error_freed", "blackbox": "error_blackbox"}
TIMING = "timing.json"


def summarise(diagnoses: Mapping[str, Path | str], compared: Mapping[str, Path | str]) -> pd.DataFrame:
    """One row per rig and held-out run, in the order of `diagnoses`.

    Args:
        diagnoses: `diagnosis.json` of each rig, with `timing.json` beside it. compared: its table of
            `compare_recording`, where there is one.
    """
    rows = [row for rig, path in diagnoses.items() for row in _of_rig(rig, Path(path), compared.get(rig))]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _of_rig(rig: str, diagnosis: Path, compared: Path | str | None) -> list[dict]:
    found = json.loads(diagnosis.read_text(encoding="utf-8"))
    theirs = _peers(compared) if compared else {}
    about = {"rig": rig, "unit": found["held_out"]["unit"], **{k: found[k] for k in ("verdict", "quanta", "converged")}}
    about |= {tier: in_cell(found["effects"], tier) for tier in ("certain", "possible")}
    about["seconds"] = json.loads(diagnosis.with_name(TIMING).read_text(encoding="utf-8"))["seconds"]
    nobody = dict.fromkeys(OF_PEERS.values(), np.nan)
    return [about | nobody | row | theirs.get(row["run"], {}) for row in found["held_out"]["runs"]]


def in_cell(effects: list[dict[str, Any]], tier: str) -> str:
    """Effects of a tier as ``effect@place:coefficient=value±halfwidth``, separated by semicolons."""
    told = [
        f"{effect['name']}:{row['name']}={row['value']:.4g}±{_half(row)}"
        for effect in effects
        for row in effect["coefficients"]
        if effect["tier"] == tier and (tier != "certain" or not _holds_nothing(row))
    ]
    return ";".join(told)


def _holds_nothing(row: Mapping[str, Any]) -> bool:
    return row["low"] is None or row["high"] is None or row["low"] <= 0 <= row["high"]


def _half(row: Mapping[str, Any]) -> str:
    return "inf" if row["low"] is None or row["high"] is None else f"{(row['high'] - row['low']) / 2:.2g}"


def _peers(path: Path | str) -> dict[str, dict[str, float]]:
    table = pd.read_csv(path, dtype={"run": str})  # runs may be called 007
    out: dict[str, dict[str, float]] = {}
    row: Any
    for row in table[table.peer.isin(list(OF_PEERS))].itertuples():
        out.setdefault(row.run, {})[OF_PEERS[row.peer]] = row.error
    return out


def gather(compared: Mapping[str, Path | str]) -> pd.DataFrame:
    """The tables of `compare_recording` of all rigs, one below the other, with a column `rig` in front."""
    parts = [pd.read_csv(path, dtype={"run": str}).assign(rig=rig) for rig, path in compared.items()]
    table = pd.concat(parts, ignore_index=True)
    return table[["rig", *(column for column in table if column != "rig")]]


def to_markdown(summary: pd.DataFrame) -> str:
    """A row per rig: verdict, seconds and the median over its held-out runs of every error, in the rig's unit, none
    where one of them has no error."""
    head = ["rig", "held-out runs", *ERRORS.values(), "seconds", "verdict"]
    lines = [head, ["---"] * len(head)]
    for rig, rows in summary.groupby("rig", sort=False):
        one = rows.iloc[0]
        errors = [_error(rows[name].median(skipna=False), one.unit) for name in ERRORS]
        said = one.verdict.replace("|", "/")
        lines.append([str(rig).replace("_", " "), str(len(rows)), *errors, f"{one.seconds:.0f}", said])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _error(value: float, unit: str) -> str:
    if not np.isfinite(value):
        return "–"
    power = 0 if unit not in ("m", "rad") or value >= 1 else 3 if value >= 1e-4 else 6
    return f"{value * 10**power:.3g} { ({0: '', 3: 'm', 6: 'µ'}[power]) }{unit}"
