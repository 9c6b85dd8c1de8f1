"""What a script about a diagnosis is told: its case, the diagnosis, and numbers of its own."""

import argparse
import json
from pathlib import Path

import numpy as np

from fimpact.cases import read_case
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch.simulate import Hypothesis
from fimpact.recordings import Recording


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
    return recording, hypotheses(json.loads(options.diagnosis.read_text()), len(recording.unknowns)), options


def hypotheses(diagnosis: dict, count: int) -> dict[str, Hypothesis]:
    """The naive fit and the answer of a diagnosis whose recording has `count` unknowns."""
    own, rest = diagnosis["parameters"][:count], diagnosis["parameters"][count:]
    values: dict[str, dict[str, float]] = {}
    for row in rest:
        values.setdefault(row["of"], {})[row["name"]] = row["after"]
    placed = []
    for name, fitted in values.items():
        effect, _, site = name.partition("@")
        placed.append(Placed(EFFECTS[effect], site, EFFECTS[effect].neutral | fitted))
    return {
        "naive fit": Hypothesis(np.array([row["naive"] for row in own])),
        "answer": Hypothesis(np.array([row["after"] for row in own]), tuple(placed)),
    }
