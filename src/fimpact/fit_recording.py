"""Fit a case with the effects that somebody insists on, and no others: no search, and no choice among names."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from fimpact.cases import read_case
from fimpact.cases.errors import CaseError, one_of
from fimpact.effects import get_effect
from fimpact.effects.base import Effect
from fimpact.effects.own import load_effects
from fimpact.mismatch.colour import colour
from fimpact.mismatch.diagnose import in_words, parameter_rows, value_in_words
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.evidence import Evidence, weigh_evidence
from fimpact.mismatch.explain import Explanation, naive_fit
from fimpact.mismatch.insist import insisted
from fimpact.mismatch.judge import Bench, bench
from fimpact.mismatch.pulses import felt
from fimpact.mismatch.weigh import both, widened
from fimpact.recordings import Recording


@dataclass(frozen=True)
class Insisted:
    """The naive fit, that with the effects, the covariance of its coordinates (k, k), disturbances counted, and what it
    is worth on held-out runs."""

    recording: Recording
    naive: Explanation
    best: Explanation
    covariance: np.ndarray
    evidence: Evidence


def fit_recording(
    case: Path | str,
    data: Path | str | None,
    names: Sequence[str],
    progress: Callable[[str], None],
    effects: Path | str | None = None,
) -> Insisted:
    """Fit the model of `case` with the effects `names`, ``effect@site`` each.

    Args:
        data: folder of the data files; None: the one that the case names.
        progress: receives one line at the start of each piece of work.
        effects: Python file that adds effects to the catalogue; None: there is none.

    Raises:
        CaseError: the case or its data cannot be used, or an effect cannot be where it is said to be.
        ValueError: no effect has such a name, or `effects` cannot be run.
    """
    recording = read_case(case, data)
    if effects:
        load_effects(effects)
    made = bench(recording)
    places = _places(made, names)
    progress("fitting the model as it is")
    naive = naive_fit(made)
    progress(f"refitting with {', '.join(names)}")
    best = insisted(made, naive, places)
    silent = sorted(set(names) - {p.name for p in best.placed})
    if silent:
        raise CaseError(
            f"{silent[0]}: the training runs of {case} show nothing of it that the unknowns would not do as well, or "
            "all of them diverge; leave it out"
        )
    return Insisted(recording, naive, best, _covariance(made, naive, best), weigh_evidence(made, naive, best))


def _places(made: Bench, names: Sequence[str]) -> list[tuple[Effect, str]]:
    simulator, found = made.training.simulator, []
    for name in names:
        known, at, site = name.partition("@")
        if not at:
            raise CaseError(f"{name!r} says no place; write EFFECT@SITE, such as coulomb@JOINT")
        effect = get_effect(known)
        sites = effect.sites(simulator.base, simulator.recording.channels)
        found.append((effect, one_of(sites, site, f"site of {known}", "the model")))
    if len(set(names)) < len(names):
        raise CaseError(f"{max(names, key=list(names).count)} is said twice; once is enough")
    return found


def _covariance(made: Bench, naive: Explanation, best: Explanation) -> np.ndarray:
    found = felt(made.training, naive.fitted), felt(made.held_out, naive.judged)
    pushing = disturbance(best.fitted, found[0])
    return widened(both(made, best), [colour(windows, pushing) for windows in found])[1]


def in_lines(found: Insisted) -> list[str]:
    """What was fitted, a line for each unknown and each effect with 95 % intervals, and what it is worth."""
    own = [row for row in parameter_rows(found, found.recording) if row["before"] is not None]
    told = found.evidence
    return [
        *(f"{value_in_words(row)} at {row['of'].partition('@')[2]} (naive fit: {row['naive']:.3g})" for row in own),
        *(in_words(found, found.recording, placed) for placed in found.best.placed),
        f"held-out error: {told.after:.3g} standard deviations of the noise, naive fit: {told.before:.3g}; "
        f"{told.improvement:.0%} less ({told.low:.0%} to {told.high:.0%})",
    ]


def as_json(found: Insisted) -> str:
    """The same as a diagnosis has it: ``parameters`` and ``evidence``."""
    rows, told = parameter_rows(found, found.recording), found.evidence
    return json.dumps({"parameters": rows, "evidence": {**asdict(told), "white": told.white}}, indent=1) + "\n"
