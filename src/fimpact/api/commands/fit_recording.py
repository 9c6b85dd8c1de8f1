"""Fit a case with the effects that somebody insists on, and no others: no search, and no choice among names."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.cases import read_case
from fimpact.cases.errors import CaseError, one_of
from fimpact.diagnosis.held_out import Proof, prove
from fimpact.diagnosis.pipeline import plain
from fimpact.diagnosis.wording.certainty import parameter_rows
from fimpact.diagnosis.wording.verdict import value_in_words
from fimpact.effects import get_effect
from fimpact.effects.base import Effect, words
from fimpact.effects.plugins import load_effects
from fimpact.recordings import Recording
from fimpact.selection.forced import fit_forced
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import Smoothed
from fimpact.smoothing.time_step import settled


@dataclass(frozen=True)
class Insisted:
    """The naive fit, that with the effects, and what both are worth on held-out runs (None: there are none)."""

    naive: Smoothed
    best: Smoothed
    proof: Proof | None

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """A row for each number, with its value in the naive fit, None where it has none there."""
        naive = {number.of: number.value for number in self.naive.numbers}
        rows = parameter_rows(self.best, self.best.track.recording)
        return [row | {"naive": naive.get(row["of"])} for row in rows]


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
        CaseError: the case or its data cannot be used, an effect cannot be where it is said to be, or the fit does not
            converge. ValueError: no effect has such a name, or `effects` cannot be run.
    """
    recording = read_case(case, data)
    if effects:
        load_effects(effects)
    return fit_effects(recording, names, progress, str(case))


def fit_effects(
    recording: Recording, names: Sequence[str], progress: Callable[[str], None], where: str = "the recording"
) -> Insisted:
    """Fit the model of a recording with the effects `names`, ``effect@site`` each.

    Args:
        progress: receives one line at the start of each piece of work. where: how messages name the recording.

    Raises:
        CaseError: an effect cannot be where it is said to be, or the fit does not converge. ValueError: no effect has
            such a name.
    """
    places = _places(recording, names)
    progress("fitting the model as it is")
    prepared = prepare(recording, progress=progress)
    naive = prepared.naive
    progress(f"refitting with {', '.join(names)}")
    best = fit_forced(prepared, naive, places, progress)
    if best.converged:
        best = settled(best, prepared.begun, prepared.noise, progress)
    if not best.converged:
        raise CaseError(
            f"the fit with {', '.join(names)} does not converge: the training runs of {where} show nothing of it that "
            "the unknowns would not do as well, or it diverges; leave out one of them"
        )
    prepared = replace(prepared, track=best.track)
    simulator, hypotheses = prepared.simulator, [Hypothesis(fit.theta, fit.placed) for fit in (naive, best)]
    progress("proving on held-out runs")
    proof = prove(
        prepared, {n: (simulator, h) for n, h in zip(("naive", "improved"), hypotheses, strict=True)}, False, progress
    )
    return Insisted(naive, best, proof)


def _places(recording: Recording, names: Sequence[str]) -> list[tuple[Effect, str]]:
    model, found = Simulator(recording).base, []
    for name in names:
        known, at, site = name.partition("@")
        if not at:
            raise CaseError(f"{name!r} says no place; write EFFECT@SITE, such as coulomb@JOINT")
        effect = get_effect(known)
        sites = effect.sites(model, recording.channels)
        found.append((effect, one_of(sites, site, f"site of {known}", "the model")))
    if len(set(names)) < len(names):
        raise CaseError(f"{max(names, key=list(names).count)} is said twice; once is enough")
    return found


def in_lines(found: Insisted) -> list[str]:
    """What was fitted, a line for each unknown and each effect with 95 % intervals, and what it is worth."""
    rows = found.parameters
    own = [row for row in rows if row["before"] is not None]
    lines = [f"{value_in_words(row)} at {row['of'].partition('@')[2]} (naive fit: {row['naive']:.3g})" for row in own]
    for placed in found.best.placed:
        numbers = ", ".join(value_in_words(row) for row in rows if row["of"] == placed.name)
        lines.append(f"{words(placed.name)} ({numbers})" if numbers else words(placed.name))
    return [*lines, _worth(found.proof)]


def _worth(proof: Proof | None) -> str:
    if proof is None:
        return "held-out error: none, no run is held out"
    naive, improved = (_overall(proof, f"error_{name}") for name in ("naive", "improved"))
    return (
        f"held-out error: {improved:.3g} {proof.unit}, naive fit: {naive:.3g} {proof.unit}, "
        f"noise floor: {proof.noise_floor:.3g} {proof.unit}"
    )


def _overall(proof: Proof, name: str) -> float:
    return float(np.sqrt(np.mean(np.array([row[name] for row in proof.runs], float) ** 2)))


def as_json(found: Insisted) -> str:
    """The same as a diagnosis has it: ``parameters``, those of effects among them, and ``held_out``."""
    proof = found.proof
    held_out = proof and {"unit": proof.unit, "noise_floor": proof.noise_floor, "runs": list(proof.runs)}
    return json.dumps(plain({"parameters": found.parameters, "held_out": held_out}), indent=1) + "\n"
