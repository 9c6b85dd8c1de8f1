"""All stages in their order: from a recording to a diagnosis that can be written down."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from fimpact.deciding import UNLIKELY
from fimpact.diagnosis.blind_record import share_that_held
from fimpact.diagnosis.freed_model import fit_freed
from fimpact.diagnosis.held_out import Proof, prove
from fimpact.diagnosis.identifiability.blind_spots import not_shown
from fimpact.diagnosis.identifiability.sentences import Told
from fimpact.diagnosis.notes import notes_on
from fimpact.diagnosis.remainder import missing_rows, picture, remainder
from fimpact.diagnosis.wording.certainty import NAMELESS, SLIGHT, Finding, findings, parameter_rows
from fimpact.diagnosis.wording.verdict import verdict
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.recordings import Recording
from fimpact.selection.explanation import Explanation, explain
from fimpact.selection.one_round import Round
from fimpact.selection.search_scope import Limits
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.smoothing.prepare import Prepared, prepare

SCHEMA = 3
MOST_ROUNDS = 5  # of what was tried next in a round that are told
NONE, UNNAMED = "none", "unnamed"
NAMELESS_RIVAL = "something that has no name in the catalogue"


@dataclass(frozen=True)
class Member:
    """One explanation that the recordings leave: its name, ``effect@site`` joined by +, its hypothesis, its weight."""

    name: str
    hypothesis: Hypothesis
    weight: float


@dataclass(frozen=True)
class Diagnosis:
    """What every stage found; `verdict` says it in a few short sentences, `unshown` what no stage could find."""

    recording: Recording
    prepared: Prepared
    explanation: Explanation
    naive: Hypothesis
    best: Hypothesis
    members: tuple[Member, ...]
    effects: tuple[Finding, ...]
    parameters: list[dict[str, Any]]
    proof: Proof | None
    remainder: dict[str, Any]
    notes: tuple[str, ...]
    answer: str
    verdict: str
    unshown: tuple[Told, ...] = ()

    @property
    def simulator(self) -> Simulator:
        """Simulates the training runs' model."""
        return self.prepared.simulator

    @property
    def answer_set(self) -> list[str]:
        """Names of all that the recordings leave, the answer first; `UNNAMED` last, where it may be nothing of them."""
        named = [member.name for member in self.members] or [self.answer]
        return named + [UNNAMED] * (self.nameless > UNLIKELY and UNNAMED not in named)

    @property
    def nameless(self) -> float:
        """How likely, beside the answer's 1, something without a name stands in the place of one of its names."""
        return _nameless(self.explanation) if self.members else 0.0

    @property
    def confidence(self) -> float | None:
        """The answer's share of the belief in all that the recordings leave, times how often such answers held the
        truth, blind; None where nothing is named."""
        if self.answer in (NONE, UNNAMED):
            return None
        total = sum(member.weight for member in self.members) + self.nameless
        return share_that_held(len(self.answer_set) > 1) / total

    @property
    def converged(self) -> bool:
        """Whether the fits behind the answer converged."""
        return self.explanation.naive.converged and self.explanation.final.converged


def diagnose(
    recording: Recording,
    progress: Callable[[str], None] = lambda line: None,
    brief: bool = False,
    limits: Limits | None = None,
) -> Diagnosis:
    """Smooth, select, prove.

    Args:
        progress: receives one line at the start of each piece of work.
        brief: proves at the case's own horizon only and without the freed model, and leaves out the missing force of
            held-out runs, and what the recordings cannot show: what no answer depends on.
        limits: of what is asked for; None: of all.
    """
    progress("preparing the recordings")
    prepared = prepare(recording, progress=progress)
    found = explain(
        prepared.track, prepared.begun, prepared.noise, list(EFFECTS.values()), progress, limits, prepared.late,
        prepared.known,
    )  # fmt: skip
    prepared = replace(prepared, track=found.final.track)
    naive, best = Hypothesis(found.naive.theta), Hypothesis(found.final.theta, found.final.placed)
    models = {"naive": (prepared.proving, naive), "improved": (prepared.proving, best)}
    if recording.held_out:
        progress("proving on held-out runs")
    if recording.held_out and not brief:
        models["freed"] = fit_freed(prepared, found.naive.states)
    proof = prove(prepared, models, own_only=brief, progress=progress)
    rows = parameter_rows(found.final, recording)
    effects = findings(found.final, found.slight, rows, found.left.doubted)
    left = remainder(prepared, found, proof, brief)
    notes = [*notes_on(prepared, found), *found.unasked]
    answer = _answer(effects, left)
    members = _members(found, answer)
    missing = answer != NONE
    others = [NAMELESS_RIVAL] * (bool(members) and _nameless(found) > UNLIKELY) + [m.name for m in members[1:]]
    words = verdict(effects, others, missing, left["sentence"] if missing else "", notes)
    rivals = {p.name for own in (found.final.placed, *(a.placed for a in found.alternatives)) for p in own}
    unshown = () if brief or found.asked is None else not_shown(recording, found.asked(), rivals)
    return Diagnosis(
        recording, prepared, found, naive, best, members, effects, rows, proof, left, tuple(notes), answer, words,
        unshown,
    )  # fmt: skip


def _answer(effects: Sequence[Finding], left: dict[str, Any]) -> str:
    main = [f for f in effects if f.tier != SLIGHT]
    named = sorted(f.name for f in main if f.seen) or sorted(f.name for f in main if f.why_not != NAMELESS)
    return "+".join(named) or (UNNAMED if left["unnamed"] or main else NONE)


def _nameless(found: Explanation) -> float:
    """How likely something without a name stands in the place of a name that is no small refinement."""
    return max((own for name, own in found.left.instead.items() if name not in found.slight), default=0.0)


def _members(found: Explanation, answer: str) -> tuple[Member, ...]:
    def name(placed: Sequence[Placed]) -> str:
        return "+".join(sorted(p.name for p in placed))

    if not found.final.placed:
        return ()
    own = [Member(answer, Hypothesis(found.final.theta, found.final.placed), 1.0)]
    for other in found.alternatives:
        if other.placed and name(other.placed) not in [m.name for m in own]:
            own.append(Member(name(other.placed), Hypothesis(other.theta, other.placed), other.weight))
    return tuple(own)


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything a report shows, in plain types; the same diagnosis gives the same bytes."""
    found = diagnosis.explanation
    placed = found.final.placed
    return plain({
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "answer": diagnosis.answer,
        "answer_set": diagnosis.answer_set,
        "confidence": diagnosis.confidence,
        "members": [{p.name: p.values for p in m.hypothesis.placed} for m in diagnosis.members],
        "p": found.p,
        "acts_in": ("contact" if all(p.effect.touching for p in placed) else "any") if placed else None,
        "runs": [run.name for run in diagnosis.recording.runs],
        "converged": diagnosis.converged,
        "quanta": diagnosis.prepared.track.quanta,
        "effects": [_effect(finding) for finding in diagnosis.effects],
        "parameters": [row for row in diagnosis.parameters if row["before"] is not None],
        "rounds": [_round(r, diagnosis) for r in found.rounds],
        "missing_force": missing_rows(found),
        "missing_force_held_out": diagnosis.remainder["held_out"],
        "remainder": {k: v for k, v in diagnosis.remainder.items() if k != "held_out"},
        "notes": list(diagnosis.notes),
        "cannot_show": [{**asdict(own), "names": list(own.names)} for own in diagnosis.unshown],
        "held_out": _proof(diagnosis.proof),
        "picture": picture(diagnosis.prepared, found),
    })  # fmt: skip


def plain(value: Any) -> Any:
    """Numbers as Python has them; None for what is no number."""
    if isinstance(value, dict):
        return {str(key): plain(own) for key, own in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(own) for own in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _effect(finding: Finding) -> dict[str, Any]:
    rows = [
        {"name": r["name"], "unit": r["unit"], "value": r["after"], "low": r["low"], "high": r["high"]}
        for r in finding.rows
    ]
    return {
        "effect": finding.effect, "site": finding.site, "name": finding.name, "tier": finding.tier,
        "coefficients": rows, "why_not": finding.why_not,
    }  # fmt: skip


def _round(made: Round, diagnosis: Diagnosis) -> dict[str, Any]:
    chosen = made.chosen
    others = [t for t in made.tried if t.gain > 0 and not (chosen and t.option is chosen.option)]
    following = [[t.option.name, t.gain] for t in others[:MOST_ROUNDS]]
    if chosen is None:
        return {"class": None, "places": [], "gain": 0.0, "se": 0.0, "share": 0.0, "place": "", "next": following}
    dofs = diagnosis.simulator.base
    place = dofs.joint(int(dofs.dof_jntid[chosen.place[1]])).name
    return {
        "class": chosen.option.name, "places": list(chosen.places), "gain": chosen.gain, "se": chosen.error,
        "share": chosen.share, "place": place, "next": following,
    }  # fmt: skip


def _proof(proof: Proof | None) -> dict[str, Any]:
    if proof is None:
        return {"unit": "", "noise_floor": None, "horizons": [], "runs": [], "curve": {}}
    return {
        "unit": proof.unit, "noise_floor": proof.noise_floor, "horizons": proof.horizons, "runs": list(proof.runs),
        "curve": proof.curves,
    }  # fmt: skip
