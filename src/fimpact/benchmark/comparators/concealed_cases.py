"""What others would do with the same recordings, judged alike: held-out error with initial states fitted.

- `mujoco.sysid` fits the naive model's parameters, from the model's own values and from the best of five draws; and
  the black-box residual: both as in `fimpact.benchmark.comparators.toolboxes`.
- Refitting every candidate of the catalogue to convergence and choosing by its likelihood, with no screening.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.benchmark.archive import load_recording
from fimpact.benchmark.comparators.free_parameters import own_knobs
from fimpact.benchmark.comparators.toolboxes import black_box, fit_sysid, require_sysid
from fimpact.benchmark.jsonl import Report, each, held_out_error
from fimpact.diagnosis.held_out import prove
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.forced import fit_forced
from fimpact.selection.regression import Regression
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.smoothing.candidates import candidates
from fimpact.smoothing.columns import columns, motion_scales
from fimpact.smoothing.prepare import Prepared, prepare
from fimpact.smoothing.smoother import Smoothed

STARTS, SPREAD = 5, 3.0  # of mujoco.sysid, and prior standard deviations within which they are drawn
NOTHING = "none"


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
    prepared = prepare(recording)
    naive = prepared.naive
    out: dict[str, Any] = {}
    for name in peers:
        report(f"{name} of {prepared.track.count} samples")
        since = time.perf_counter()
        out |= COMPARATORS[name](prepared, naive)
        out[f"{name}_seconds"] = time.perf_counter() - since
    return out


def _error(prepared: Prepared, hypothesis: Hypothesis) -> float | None:
    proof = prove(prepared, {"peer": (prepared.proving, hypothesis)})
    return held_out_error(proof.runs, "peer") if proof else None


def _sysid(prepared: Prepared, naive: Smoothed) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    knobs = own_knobs(prepared)
    draws = rng.uniform(-SPREAD, SPREAD, (STARTS, len(knobs.start)))
    draws[0] = 0.0
    found = [fit_sysid(prepared, knobs, knobs.start + knobs.scale * draw) for draw in draws]
    best = min(found, key=lambda pair: pair[0])
    single, five = (_error(prepared, Hypothesis(theta)) for theta in (found[0][1], best[1]))
    return {"heldout_sysid": single, "heldout_sysid_five": five}


def _refit_all(prepared: Prepared, naive: Smoothed) -> dict[str, Any]:
    """The marginal likelihood counts what a parameter costs, as its approximation BIC does."""
    since = time.perf_counter()
    tried = candidates(list(EFFECTS.values()), prepared.track, motion_scales(naive))
    Regression(naive, columns(naive, tried))
    screening = time.perf_counter() - since
    places = list(dict.fromkeys((candidate.effect.name, candidate.site) for candidate in tried))
    fits = {NOTHING: naive}
    fits |= {f"{name}@{site}": fit_forced(prepared, naive, [(EFFECTS[name], site)]) for name, site in places}
    chosen = min(fits, key=lambda name: fits[name].loss() if fits[name].converged else np.inf)
    best = fits[chosen]
    return {
        "screening_seconds": screening,
        "refits": len(places),
        "screened": len(tried),
        "answer_refit_all": chosen,
        "heldout_refit_all": _error(prepared, Hypothesis(best.theta, best.placed)),
    }


def _blackbox(prepared: Prepared, naive: Smoothed) -> dict[str, Any]:
    return {"heldout_blackbox": _error(prepared, black_box(naive))}


COMPARATORS = {"sysid": _sysid, "blackbox": _blackbox, "refit_all": _refit_all}
PEERS = tuple(COMPARATORS)  # the slowest last
