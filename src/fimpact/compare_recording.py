"""Compare: what others make of the same recording, each run that was held out apart."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pandas as pd

from fimpact.knobs import Knobs, freed, freed_knobs, own_knobs
from fimpact.mismatch.explain import naive_fit
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, again, bench, correct, settle
from fimpact.mismatch.per_run import error_per_run, unit_of
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.simulate import Hypothesis
from fimpact.peers import fit_sysid, judge_black_box
from fimpact.recordings import Recording

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


def _sysid(recording: Recording, knobs: Callable[[Problem], Knobs] = own_knobs):
    made = bench(recording)
    own = knobs(made.training)
    _, theta = fit_sysid(made.training, own)
    # Judged without the time step's error, it is fitted without it too, as our own model is.
    correct(made, made.training, settle(made.training, Hypothesis(theta)).point)
    _, theta = fit_sysid(made.training, own, theta)
    return _judged(made, settle(made.held_out, Hypothesis(theta)))


def _sysid_freed(recording: Recording):
    return _sysid(freed(recording), freed_knobs)


def _blackbox(recording: Recording):
    made = bench(recording)
    return _judged(made, judge_black_box(made, naive_fit(made)))


def _judged(made: Bench, judged: Fit) -> tuple[str, dict[str, float]]:
    return unit_of(made), error_per_run(made, again(made, made.held_out, judged))


PEERS = {"sysid": _sysid, "sysid_freed": _sysid_freed, "blackbox": _blackbox}
