"""How well a diagnosis predicts held-out runs over windows of another length than it was made with.

python benchmarks/longer_windows.py config/recordings/double_pendulum.yaml DIAGNOSIS.json --window 1.0 --data FOLDER

Only the initial states of the windows are fitted, under the naive fit and under the answer; errors are root mean
squares, in standard deviations of the noise.
"""

import argparse
import dataclasses
import json
from pathlib import Path

import numpy as np
from force_residual import hypotheses

from fimpact.cases import read_case
from fimpact.mismatch.judge import again, bench, settle


def main() -> None:
    """A line for the naive fit and one for the answer: all held-out windows together, and by run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", type=Path)
    parser.add_argument("diagnosis", type=Path)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--window", type=float, default=1.0, help="s")
    options = parser.parse_args()
    recording = dataclasses.replace(read_case(options.case, options.data), window=options.window)
    made, found = bench(recording), json.loads(options.diagnosis.read_text())
    for label, hypothesis in hypotheses(found, len(recording.unknowns)).items():
        point = again(made, made.held_out, settle(made.held_out, hypothesis)).point
        runs = made.held_out.windows.runs
        own = (np.sqrt(point.squares[runs == k].sum() / point.samples[runs == k].sum()) for k in np.unique(runs))
        named = zip((recording.held_out[k].name for k in np.unique(runs)), own, strict=True)
        total = np.sqrt(point.squares.sum() / point.samples.sum())
        print(f"{label}: {total:.4g} ({', '.join(f'{name} {error:.4g}' for name, error in named)})")


if __name__ == "__main__":
    main()
