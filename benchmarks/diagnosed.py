"""What a script about a diagnosis is told: its case, the diagnosis, and numbers of its own."""

import argparse
import json
from pathlib import Path

import numpy as np

from fimpact.cases import read_case
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis


def told(doc: str, **numbers: tuple[float, str]) -> tuple[Recording, dict[str, Hypothesis], argparse.Namespace]:
    """The recording and the hypotheses that the command line names, and its options.

    Args:
        doc: of the script. numbers: further options, (default, unit) each.
    """
    parser = argparse.ArgumentParser(description=doc.splitlines()[0])
    parser.add_argument("case", type=Path)
    parser.add_argument("diagnosis", type=Path)
    parser.add_argument("--data", type=Path)
    for name, (default, unit) in numbers.items():
        parser.add_argument(f"--{name}", type=float, default=default, help=unit)
    options = parser.parse_args()
    recording = read_case(options.case, options.data)
    return recording, hypotheses(json.loads(options.diagnosis.read_text(encoding="utf-8")), recording), options


def hypotheses(diagnosis: dict, recording: Recording) -> dict[str, Hypothesis]:
    """The naive fit and the answer of a diagnosis of `recording`."""
    rows = {row["of"]: row for row in diagnosis["parameters"]}
    theta = {when: np.array([rows[u.name][when] for u in recording.unknowns]) for when in ("before", "after")}
    members = diagnosis.get("members") or [{}]
    placed = tuple(_placed(name, values) for name, values in members[0].items())
    return {"naive fit": Hypothesis(theta["before"]), "answer": Hypothesis(theta["after"], placed)}


def _placed(name: str, values: dict[str, float | None]) -> Placed:
    effect, _, site = name.partition("@")
    known = {key: value for key, value in values.items() if value is not None}  # None: infinite, as it is by itself
    return Placed(EFFECTS[effect], site, EFFECTS[effect].neutral | known)
