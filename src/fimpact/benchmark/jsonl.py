"""Rows about cases on disk, one JSON object per line, and the work that makes them."""

import json
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.recordings import Run

DONE = "done"
Report = Callable[[str], None]
Arrays = dict[str, np.ndarray]


def runs_of(arrays: Arrays) -> dict[str, Run]:
    """Runs by case/way, from arrays by case/way/name; what was not measured yet is empty."""
    out = {}
    for place in sorted({name.rpartition("/")[0] for name in arrays}):
        ctrl, qpos, qvel = (arrays[f"{place}/{name}"] for name in ("ctrl", "qpos", "qvel"))
        measured = arrays.get(f"{place}/measured", np.empty((0, 0)))
        out[place] = Run(place.rpartition("/")[2], ctrl, measured, False, qpos, qvel)
    return out


def each(
    cases: Iterable[str], work: Callable[[str], dict[str, Any]], report: Report, strict: bool = False
) -> Iterator[dict[str, Any]]:
    """`work` done for every case: a row each with the seconds it took; a failure is a row too, unless `strict`."""
    for case in cases:
        since = time.perf_counter()
        try:
            row = work(case)
        except Exception as error:  # one case that cannot be done must not cost the others
            if strict:
                raise
            row = {"status": f"failed: {type(error).__name__}: {error}"}
        row = {"case": case, "status": DONE, **row, "job_seconds": time.perf_counter() - since}
        report(f"{case}: {row['status']} in {row['job_seconds']:.1f} s")
        yield row


def held_out_error(runs: Iterable[dict[str, Any]], model: str) -> float | None:
    """Root mean square error of a `model` over held-out `runs`, as a proof has them, in sd of noise; None: no runs."""
    errors = [np.inf if run[f"error_{model}"] is None else run[f"error_{model}"] / run["noise_floor"] for run in runs]
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else None


def read_rows(path: str | Path) -> dict[str, dict[str, Any]]:
    """Rows of a JSONL file by their case."""
    lines = Path(path).read_text(encoding="utf-8").split("\n")  # splitlines would break at a text's own separators
    return {row["case"]: row for row in map(json.loads, filter(None, lines))}


def as_lines(rows: Iterable[dict[str, Any]]) -> str:
    """Rows as JSONL."""
    return "\n".join(json.dumps(row, default=float) for row in rows)
