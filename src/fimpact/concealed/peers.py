"""What others would do with the same recordings, judged alike: held-out error with initial states fitted.

- `mujoco.sysid` fits the naive model's parameters, from the model's own values and from the best of five draws; and
  the black-box residual: both as in `fimpact.peers`.
- Refitting every candidate of the catalogue to convergence and choosing by BIC, with no screening.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.concealed.archive import load_recording
from fimpact.concealed.rows import Report, each
from fimpact.effects import EFFECTS
from fimpact.knobs import own_knobs
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import Explanation, explain, naive_fit, refit
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, again, bench, settle
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import Candidate, proposals, screen
from fimpact.mismatch.simulate import Hypothesis
from fimpact.peers import fit_sysid, judge_black_box, require_sysid
from fimpact.recordings import Recording

STARTS, SPREAD = 5, 3.0  # of mujoco.sysid, and prior standard deviations within which they are drawn


def compare_part(
    recordings: Path, chosen: Sequence[str], refitted: Sequence[str], report: Report
) -> list[dict[str, Any]]:
    """A row for each of the `chosen` cases in the folder `recordings`; every candidate is refitted in `refitted`.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    if chosen:
        require_sysid()

    def work(case: str) -> dict[str, Any]:
        return compare(load_recording(recordings, case), PEERS if case in refitted else PEERS[:-1], report)

    return list(each(chosen, work, report))


def compare(recording: Recording, peers: Sequence[str], report: Report = lambda line: None) -> dict[str, Any]:
    """Held-out error and seconds of each of the `peers` on one recording."""
    made = bench(recording)
    naive = naive_fit(made)
    out = {}
    for name in peers:
        report(f"{name} of {len(made.training.windows.runs)} windows")
        since = time.perf_counter()
        out |= COMPARATORS[name](made, naive)
        out[f"{name}_seconds"] = time.perf_counter() - since
    return out


def held_out_error(made: Bench, naive: Explanation, other: Explanation) -> float:
    """Root mean square held-out error of `other`, in standard deviations of the noise."""
    return weigh_evidence(made, naive, other).after


def _judged(made: Bench, naive: Explanation, hypothesis: Hypothesis) -> float:
    return _error(made, naive, settle(made.held_out, hypothesis, naive.judged.point))


def _error(made: Bench, naive: Explanation, judged: Fit) -> float:
    """Held-out error of `judged`, its initial states and the time step's error sought as for our own models."""
    before = made.offsets
    error = held_out_error(made, naive, explain(naive.fitted, again(made, made.held_out, judged)))
    made.restore(before)
    return error


def _sysid(made: Bench, naive: Explanation) -> dict[str, float]:
    rng = np.random.default_rng(0)
    knobs = own_knobs(made.training)
    draws = rng.uniform(-SPREAD, SPREAD, (STARTS, len(knobs.start)))
    draws[0] = 0.0
    found = [fit_sysid(made.training, knobs, knobs.start + knobs.scale * draw) for draw in draws]
    single = _judged(made, naive, Hypothesis(found[0][1]))
    best = min(found, key=lambda pair: pair[0])
    return {"heldout_sysid": single, "heldout_sysid_five": _judged(made, naive, Hypothesis(best[1]))}


def _refit_all(made: Bench, naive: Explanation) -> dict[str, Any]:
    problem, point = made.training, naive.fitted.point
    tried = proposals(list(EFFECTS.values()), problem, scales(problem, point))
    since = time.perf_counter()
    screened = screen(problem, naive.fitted, tried)
    screening = time.perf_counter() - since
    best: dict[str, Candidate] = {}
    for candidate in sorted(screened, key=lambda c: -c.gain):
        best.setdefault(candidate.placed.name, candidate)
    refitted = [naive, *(refit(made, naive, c) for c in best.values())]
    chosen = min(refitted, key=lambda e: _criterion(made, e))
    return {
        "screening_seconds": screening,
        "refits": len(best),
        "screened": len(screened),
        "answer_refit_all": chosen.name,
        "heldout_refit_all": _error(made, naive, chosen.judged),
    }


def _criterion(made: Bench, explanation: Explanation) -> float:
    """BIC of the training windows."""
    samples = np.isfinite(made.training.windows.measured).sum()
    total = explanation.fitted.point.squares.sum()
    price = np.log(samples) * len(explanation.fitted.coordinates.scale)
    return float(total + price) if np.isfinite(explanation.deviance) else np.inf


def _blackbox(made: Bench, naive: Explanation) -> dict[str, float]:
    return {"heldout_blackbox": _error(made, naive, judge_black_box(made, naive))}


COMPARATORS = {"sysid": _sysid, "blackbox": _blackbox, "refit_all": _refit_all}
PEERS = tuple(COMPARATORS)  # the slowest last
