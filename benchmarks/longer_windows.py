"""How well a diagnosis predicts held-out runs over windows of another length than it was made with.

python benchmarks/longer_windows.py config/recordings/double_pendulum.yaml DIAGNOSIS.json --window 1.0 --data FOLDER

Only the initial states of the windows are fitted, under the naive fit and under the answer; errors are root mean
squares, in standard deviations of the noise.
"""

import dataclasses

import numpy as np
from diagnosed import told

from fimpact.mismatch.judge import again, bench, settle


def main() -> None:
    """A line for the naive fit and one for the answer: all held-out windows together, and by run."""
    recording, tried, options = told(__doc__, window=(1.0, "s"))
    made = bench(dataclasses.replace(recording, window=options.window))
    for label, hypothesis in tried.items():
        point = again(made, made.held_out, settle(made.held_out, hypothesis)).point
        runs = made.held_out.windows.runs
        own = (np.sqrt(point.squares[runs == k].sum() / point.samples[runs == k].sum()) for k in np.unique(runs))
        named = zip((recording.held_out[k].name for k in np.unique(runs)), own, strict=True)
        total = np.sqrt(point.squares.sum() / point.samples.sum())
        print(f"{label}: {total:.4g} ({', '.join(f'{name} {error:.4g}' for name, error in named)})")


if __name__ == "__main__":
    main()
