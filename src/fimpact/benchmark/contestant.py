"""The blind side of the benchmark: it is given recordings, never what is hidden in them.

Diagnose a case; where the answer is a set, design the experiment that splits it and draw a random one of the same
limits; once both are played, say which member is left.
"""

import time
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fimpact.benchmark.archive import cases_in, load_recording
from fimpact.benchmark.jsonl import DONE, Arrays, Report, each, read_rows, runs_of
from fimpact.diagnosis.experiments.design_space import limits
from fimpact.diagnosis.experiments.next_experiment import next_experiment
from fimpact.diagnosis.experiments.resolve import resolve
from fimpact.diagnosis.experiments.separating import repeats
from fimpact.diagnosis.held_out import QUICK, starts_of
from fimpact.diagnosis.pipeline import Diagnosis, diagnose, to_json
from fimpact.export.improved_model import Predicted, write_model
from fimpact.recordings import Recording, Run
from fimpact.simulation.horizon import predict_windows
from fimpact.simulation.windows import cut

WAYS = ("designed", "random")
EXPORTED = 40  # windows in which the exported model is compared


class Stopwatch:
    """Seconds of each stage, told apart by the first word of the lines of progress."""

    def __init__(self, report: Report, first: str = "preparing"):
        self._report, self._stage, self._since = report, first, time.perf_counter()
        self.seconds: dict[str, float] = {}

    def __call__(self, line: str) -> None:
        now = time.perf_counter()
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._stage, self._since = line.split()[0].rstrip(":"), now
        self._report(line)


def diagnose_case(recording: Recording, report: Report = lambda line: None) -> tuple[dict[str, Any], Arrays]:
    """All stages of one case.

    Returns:
        What the diagnosis says, in plain types, with the export's relative difference and the seconds of each stage;
        and the experiments, ``designed`` and ``random``, or nothing.
    """
    watch = Stopwatch(report)
    diagnosis = diagnose(recording, watch, brief=True)
    watch("exporting the improved model")
    exported = _exported(diagnosis)
    watch("designing the next experiment")
    commands, predicted = _experiments(diagnosis)
    watch("done")
    own = {"exported": exported, "experiment": predicted, "seconds": watch.seconds}
    return {"status": DONE, **to_json(diagnosis), **own}, commands


def _exported(diagnosis: Diagnosis) -> float | None:
    """Relative difference of the error of the exported model in plain MuJoCo, on runs that nothing was fitted to."""
    recording, noise, simulator = diagnosis.recording, diagnosis.prepared.noise, diagnosis.simulator
    runs = recording.held_out or recording.training
    windows = cut(runs, round((recording.window or QUICK) / recording.period), EXPORTED)
    starts = diagnosis.proof.starts if diagnosis.proof else starts_of(recording, runs, noise, simulator)
    prediction, states = predict_windows(simulator, diagnosis.best, windows, starts, noise)
    with TemporaryDirectory() as folder:
        predicted = Predicted(windows, *states, prediction)
        return write_model(recording, diagnosis.best, folder, diagnosis.verdict, predicted).difference


def _experiments(diagnosis: Diagnosis) -> tuple[Arrays, dict[str, float]]:
    best = next_experiment(diagnosis)
    if best is None:
        return {}, {}
    allowed = limits(diagnosis.recording, diagnosis.simulator.base, diagnosis.prepared.noise)
    rng = _own_rng(diagnosis.recording)
    random = allowed.unpack(allowed.draw(rng, 1, waves=bool(rng.integers(2)))[0])
    parts = {"designed": (best.ctrl, best.qpos, best.qvel), "random": random}
    commands = {
        f"{way}/{name}": array
        for way, arrays in parts.items()
        for name, array in zip(("ctrl", "qpos", "qvel"), arrays, strict=True)
    }
    return commands, {"separation": best.separation, "random": best.random, "repeats": repeats(best.separation)}


def _own_rng(recording: Recording) -> np.random.Generator:
    """A generator of the case's own: one draw for all cases would be one experiment, lucky or not."""
    return np.random.default_rng(zlib.crc32(recording.runs[0].measured.tobytes()))


def resolve_case(recording: Recording, row: dict[str, Any], played: dict[str, Run]) -> dict[str, Any]:
    """What is left of a set once each experiment in `played` (way -> its run) is added, way by way."""
    return {way: _resolved(recording, row, run) for way, run in played.items()}


def _resolved(recording: Recording, row: dict[str, Any], run: Run) -> dict[str, Any]:
    since = time.perf_counter()
    ranked, left = resolve(recording, [run], row["answer_set"])
    weights = {e.name: e.weight for e in ranked}
    return {"answer_set": left, "weights": weights, "seconds": time.perf_counter() - since}


def diagnose_part(recordings: Path, report: Report) -> tuple[list[dict[str, Any]], Arrays]:
    """Every case in the folder `recordings`: a row each, and the experiments to play, by case/way/name."""
    commands: Arrays = {}

    def work(case: str) -> dict[str, Any]:
        row, own = diagnose_case(load_recording(recordings, case), report)
        commands.update({f"{case}/{name}": array for name, array in own.items()})
        return row

    return list(each(cases_in(recordings), work, report)), commands


def resolve_part(recordings: Path, diagnoses: Path, commands: Arrays, played: Arrays, report: Report) -> list[dict]:
    """A row for every case whose experiments were played: what each of them leaves of the set."""
    rows, runs = read_rows(diagnoses), runs_of(commands | played)
    ways = {case: {w: runs[f"{case}/{w}"] for w in WAYS if f"{case}/{w}/measured" in played} for case in rows}

    def work(case: str) -> dict[str, Any]:
        return resolve_case(load_recording(recordings, case), rows[case], ways[case])

    return list(each([case for case, own in ways.items() if own], work, report))
