"""Summary of the recordings: a row per rig and held-out run, our errors beside those of others."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

COLUMNS = (
    "rig",
    "run",
    "verdict",
    "error_naive",
    "error_peer_freed",
    "error_blackbox",
    "error_improved",
    "noise_floor",
    "unit",
)
ERRORS = {
    "error_naive": "naive fit",
    "error_peer_freed": "everything freed",
    "error_blackbox": "black box",
    "error_improved": "improved",
    "noise_floor": "noise floor",
}
OF_PEERS = {"sysid_freed": "error_peer_freed", "blackbox": "error_blackbox"}


def summarise(diagnoses: Mapping[str, Path | str], compared: Mapping[str, Path | str]) -> pd.DataFrame:
    """One row per rig and held-out run, in the order of `diagnoses`.

    Args:
        diagnoses: `diagnosis.json` of each rig. compared: its table of `compare_recording`, where there is one.
    """
    rows = [row for rig, path in diagnoses.items() for row in _of_rig(rig, path, compared.get(rig))]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _of_rig(rig: str, diagnosis: Path | str, compared: Path | str | None) -> list[dict]:
    found = json.loads(Path(diagnosis).read_text(encoding="utf-8"))
    theirs = _peers(compared) if compared else {}
    about = {"rig": rig, "verdict": found["verdict"], "unit": found["held_out"]["unit"]}
    return [about | row | theirs.get(row["run"], {}) for row in found["held_out"]["runs"]]


def _peers(path: Path | str) -> dict[str, dict[str, float]]:
    table, out = pd.read_csv(path, dtype={"run": str}), {}  # runs may be called 007
    for row in table[table.peer.isin(list(OF_PEERS))].itertuples():
        out.setdefault(row.run, {})[OF_PEERS[row.peer]] = row.error
    return out


def gather(compared: Mapping[str, Path | str]) -> pd.DataFrame:
    """The tables of `compare_recording` of all rigs, one below the other, with a column `rig` in front."""
    parts = [pd.read_csv(path, dtype={"run": str}).assign(rig=rig) for rig, path in compared.items()]
    table = pd.concat(parts, ignore_index=True)
    return table[["rig", *(column for column in table if column != "rig")]]


def to_markdown(summary: pd.DataFrame) -> str:
    """A row per rig: the verdict, and the median over its held-out runs of every error, in the rig's unit; none where
    one of them has no error."""
    head = ["rig", "held-out runs", *ERRORS.values(), "verdict"]
    lines = [head, ["---"] * len(head)]
    for rig, rows in summary.groupby("rig", sort=False):
        runs = str(len(rows))
        errors = [_error(rows[name].median(skipna=False), rows.unit.iloc[0]) for name in ERRORS]
        lines.append([str(rig).replace("_", " "), runs, *errors, rows.verdict.iloc[0].replace("|", "/")])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _error(value: float, unit: str) -> str:
    if not np.isfinite(value):
        return "–"
    power = 0 if unit not in ("m", "rad") or value >= 1 else 3 if value >= 1e-4 else 6
    return f"{value * 10**power:.3g} { ({0: '', 3: 'm', 6: 'µ'}[power]) }{unit}"
