"""How long a diagnosis takes, in quanta: forward simulations of all training data at the step that is simulated with.

python benchmarks/diagnosis.py CASE.yaml ... [--data FOLDER]

A line for each case: the quantum, then the naive smoothing, one screening of the whole catalogue and the whole
diagnosis, each in seconds and quanta. A computer's pace changes by the hour; a quantum changes with it.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.cases import read_case
from fimpact.diagnosis.pipeline import diagnose
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.one_round import search
from fimpact.selection.options import options
from fimpact.selection.regression import Regression
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.smoothing.candidates import candidates
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.smoother import Smoothed, smooth

TURNS = 5


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds that `work` takes, and what it returns."""
    begun = time.perf_counter()
    done = work()
    return time.perf_counter() - begun, done


def quantum(prepared: Prepared) -> float:
    """Seconds of one simulation of all training data; the quickest counts, what else is done only ever adds."""
    track, states = prepared.track, prepared.begun
    model = track.simulator.model(Hypothesis(track.simulator.theta))
    given = states.qpos, states.qvel, states.act, track.ctrl[:, 0], np.zeros_like(states.qvel)
    return min(timed(lambda: track.simulator.advance(model, *given))[0] for _ in range(TURNS))


def screened(smoothed: Smoothed) -> None:
    """One round of the search: every effect at every place, and every class of places."""
    track = smoothed.track
    tried = candidates(list(EFFECTS.values()), track, motion_scales(smoothed))
    offered = options(track.model, track.recording.channels, tried)
    search(Regression(smoothed, columns(smoothed, tried)), offered, (smoothed.tau**2).sum(0), 0.0)


def stages(recording: Recording) -> tuple[float, dict[str, float]]:
    """The quantum, s, and seconds of each stage."""
    prepared = prepare(recording)
    unit = quantum(prepared)
    found = {}
    found["smoothing"], naive = timed(lambda: smooth(prepared.track, prepared.begun, prepared.noise))
    found["screening"], _ = timed(lambda: screened(naive))
    found["whole"], _ = timed(lambda: diagnose(recording))
    return unit, found


def main() -> None:
    """A line for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="+", type=Path)
    parser.add_argument("--data", type=Path)
    given = parser.parse_args()
    for case in given.cases:
        unit, found = stages(read_case(case, given.data))
        told = ", ".join(f"{stage} {taken:.1f} s ({taken / unit:.0f})" for stage, taken in found.items())
        print(f"{case.stem}: quantum {1e3 * unit:.1f} ms, {told}", flush=True)


if __name__ == "__main__":
    main()
