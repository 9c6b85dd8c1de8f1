"""Compare: what others make of the same recording, each run that was held out apart."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pandas as pd

from fimpact.benchmark.comparators.free_parameters import freed_knobs, own_knobs
from fimpact.benchmark.comparators.toolboxes import black_box, fit_sysid
from fimpact.diagnosis.freed_model import freed
from fimpact.diagnosis.held_out import prove
from fimpact.recordings import Recording
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.smoothing.prepare import Prepared, prepare

COLUMNS = ("peer", "run", "error", "unit", "seconds", "status")
DONE = "done"


def compare_recording(recording: Recording, limit: float, report: Callable[[str], None]) -> pd.DataFrame:
    """Held-out error of every peer on every held-out run, with initial states fitted as for our own models.

    Args:
        limit: s that each peer may take; only the main thread of a process can be interrupted so.

    Returns:
        A row per peer and held-out run: peer, run, error and its unit, seconds of the peer, and status: "done", or why
        there is no error.
    """
    rows = []
    for name, peer in PEERS.items():
        since = time.perf_counter()
        errors, status = _tried(peer, recording, limit)
        seconds = time.perf_counter() - since
        report(f"{name}: {status} in {seconds:.0f} s")
        unit, runs = errors
        rows += [(name, run, error, unit, seconds, _status(error, status)) for run, error in runs.items()]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _tried(peer, recording: Recording, limit: float) -> tuple[tuple[str, dict[str, float]], str]:
    try:
        with at_most(limit):
            return peer(recording), DONE
    except Exception as error:  # a comparator that cannot do it must not cost the others
        words = " ".join(str(error).split())
        status = words if isinstance(error, TimeoutError) else f"{type(error).__name__}: {words}"
        return ("", {run.name: np.nan for run in recording.held_out}), status


def _status(error: float, status: str) -> str:
    return "its simulation diverges" if status == DONE and not np.isfinite(error) else status


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """End what is done within after so many seconds.

    Raises:
        TimeoutError: the time was up.
    """

    def stop(*_):
        raise TimeoutError(f"stopped after {seconds:g} s, its time limit")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def _sysid(recording: Recording):
    prepared = prepare(recording)
    return _judged(prepared, Hypothesis(fit_sysid(prepared, own_knobs(prepared))[1]))


def _sysid_freed(recording: Recording):
    prepared = prepare(freed(recording))
    return _judged(prepared, Hypothesis(fit_sysid(prepared, freed_knobs(prepared))[1]))


def _blackbox(recording: Recording):
    prepared = prepare(recording)
    naive = prepared.naive
    return _judged(prepared, black_box(naive))


def _judged(prepared: Prepared, hypothesis: Hypothesis) -> tuple[str, dict[str, float]]:
    """The unit, and the error of each held-out run."""
    proof = prove(prepared, {"peer": (prepared.proving, hypothesis)})
    if proof is None:
        return "", {}
    return proof.unit, {row["run"]: np.nan if row["error_peer"] is None else row["error_peer"] for row in proof.runs}


PEERS = {"sysid": _sysid, "sysid_freed": _sysid_freed, "blackbox": _blackbox}
