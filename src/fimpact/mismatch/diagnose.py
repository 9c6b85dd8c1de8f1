"""All stages in their order: from a recording to a diagnosis that can be written down."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from fimpact.effects import EFFECTS
from fimpact.effects.base import words
from fimpact.effects.sensing import CHANNEL
from fimpact.mismatch.evidence import Evidence, weigh_evidence
from fimpact.mismatch.explain import Explanation, sizes_of
from fimpact.mismatch.judge import Bench, bench
from fimpact.mismatch.locate import Location, locate
from fimpact.mismatch.name import name
from fimpact.mismatch.naming import SEEMING, Naming
from fimpact.mismatch.step import Step
from fimpact.recordings import FIELDS, Recording
from fimpact.units import channel_unit

SCHEMA = 2
Z95 = 1.959964
BLIND = 1e3  # times a coefficient's size: width of an interval from which the recordings do not show it
LOUD = 2.0  # times the noise: held-out error that is told where nothing is found missing
REFUSED = "The likeliest name does not improve held-out runs"
# Turns of what is no joint, though one may have the name of its site.
ELSEWHERE = ("inertia", "gravity_tilt", "ground_tilt", "misalignment")
SLIDING = {"(N m)": "N", "N m": "N", "kg m^2": "kg", "kg m²": "kg", "rad": "m"}


class Fitted(Protocol):
    """What has parameters to tell: the naive fit, the best one, and the covariance of its coordinates, (k, k)."""

    naive: Explanation
    best: Explanation
    covariance: np.ndarray


@dataclass(frozen=True)
class Diagnosis:
    """What every stage found; `verdict` says it in one sentence."""

    recording: Recording
    bench: Bench
    naming: Naming
    location: Location
    evidence: Evidence
    verdict: str

    @property
    def answer(self) -> str:
        """``effect@site`` joined by +, "none" or "unnamed"."""
        return self.naming.answer

    @property
    def acts_in(self) -> str | None:
        """Where all that was found acts: in "contact" only, or in "any" mode; None where nothing has a name, and the
        residual's own modes are all there is."""
        placed = self.naming.best.placed
        return ("contact" if all(p.effect.touching for p in placed) else "any") if placed else None


def diagnose(recording: Recording, progress: Callable[[str], None] = lambda line: None) -> Diagnosis:
    """Fit, locate, name and judge.

    Args:
        progress: receives one line at the start of each piece of work.
    """
    made = bench(recording)
    progress("fitting the model as it is")
    naming = name(made, list(EFFECTS.values()), progress)
    progress("locating what it leaves unexplained")
    location = locate(made.training, naming.naive.fitted, naming.pulses)
    evidence = weigh_evidence(made, naming.naive, naming.best)
    return Diagnosis(recording, made, naming, location, evidence, verdict(naming, recording, location, evidence))


def verdict(naming: Naming, recording: Recording, location: Location, evidence: Evidence) -> str:
    """What was found, in one or two sentences."""
    if naming.answer == "none":
        return "Nothing is missing that these recordings can show" + _loud(evidence)
    found = "; ".join(in_words(naming, recording, p) for p in naming.found)
    share = f"It explains {evidence.explained:.0%} of the explainable held-out mismatch."
    if naming.answer == "unnamed":
        where = f"that the catalogue cannot name: {location.sentence}.{_like(naming)}"
        if found and evidence.low > 0:
            return f"Missing: {found}. {share}{_chance(naming)} More is missing {where}"
        refused = found or next((words(r.name) for r in naming.steps[0].rivals), "")
        return f"Something is missing {where}" + (f" {REFUSED}: {refused}." if refused else "")
    others = [words(m.name) for m in naming.members[1:]]
    unsure = f" These recordings cannot tell it from {', '.join(others)}." if others else ""
    if not evidence.low > 0:
        return f"Something is missing. {REFUSED}: {found}.{unsure}"
    return f"Missing: {found}. {share}{unsure}{_more(naming)}"


def _loud(evidence: Evidence) -> str:
    """How far off a model is of which nothing can be said to be missing."""
    off = evidence.before / max(evidence.noise_floor, 1e-9)
    told = f", though held-out runs are {off:.2g} times the noise off: a disturbance, or too little data to name it."
    return "." if off < LOUD else told


def _more(naming: Naming) -> str:
    """Whether a named answer is sure, and all."""
    if naming.seeming:
        surely = "is" if naming.certain else "may be"
        return f"{_chance(naming)} Something beside it {surely} missing that the catalogue cannot name.{_like(naming)}"
    if naming.suspected:
        return _chance(naming)
    return " These recordings cannot rule out that more is missing." if naming.beside else ""


def _chance(naming: Naming) -> str:
    """Whether the name is surer than that there is something to name."""
    sure = " That something is missing is certain, but by itself this name could be chance."
    return sure if naming.suspected else ""


def _like(naming: Naming) -> str:
    """What it is most like that has no name, where that is more than chance."""
    return f" It is most like {naming.stranger.like}." if naming.stranger.p <= SEEMING else ""


def in_words(naming: Fitted, recording: Recording, placed) -> str:
    """An effect with values, 95 % intervals and units: ``coulomb at joint_2 (friction 0.0020 ± 0.0001 N m)``."""
    rows = [row for row in parameter_rows(naming, recording) if row["of"] == placed.name and row["before"] is None]
    # What no recording shows stays where it began, which is not knowledge.
    size = sizes_of(placed)
    rows = [row for row in rows if row["high"] - row["low"] < BLIND * size[row["name"]]] or rows
    return f"{words(placed.name)} ({', '.join(map(value_in_words, rows))})"


def value_in_words(row: dict[str, Any]) -> str:
    """``friction 0.0299 ± 0.0002 N m``; a ratio has no unit."""
    unit = "" if row["unit"] == "1" else f" {row['unit']}"
    return f"{row['name']} {row['after']:.3g} ± {_half((row['high'] - row['low']) / 2)}{unit}"


def _half(width: float) -> str:
    return f"{width:.1g}" if width < 10 else f"{width:.0f}"


def parameter_rows(naming: Fitted, recording: Recording) -> list[dict[str, Any]]:
    """One row per fitted number: name, of (the unknown or ``effect@site``), unit, before (the naive model's own
    value, None for an effect), naive (its fit without the effect), after, and its 95 % interval low, high, widened for
    the colour of the residual."""
    fitted, naive = naming.best.fitted, naming.naive.fitted
    after = fitted.coordinates.read(fitted.point.hypothesis)
    error = Z95 * np.sqrt(np.diag(naming.covariance))
    unknowns = recording.unknowns
    own, alone = naive.coordinates.mean, naive.coordinates.read(naive.point.hypothesis)
    labels = [
        (u.field, u.name, FIELDS[u.field][0], float(b), float(n)) for u, b, n in zip(unknowns, own, alone, strict=True)
    ]
    for index, coefficient in fitted.coordinates.values:
        placed = naming.best.placed[index]
        unit = next(c.unit for c in placed.effect.coefficients if c.name == coefficient)
        labels.append((coefficient, placed.name, unit, None, None))
    spec = recording.spec()
    labels = [(name, of, unit_at(spec, of, unit), *rest) for name, of, unit, *rest in labels]
    keys = ("name", "of", "unit", "before", "naive", "after", "low", "high")
    rows = zip(labels, after, after - error, after + error, strict=True)
    return [dict(zip(keys, (*label, float(v), float(lo), float(hi)), strict=True)) for label, v, lo, hi in rows]


def unit_at(spec: mujoco.MjSpec, of: str, unit: str) -> str:
    """The unit of a number of `of`, ``field@site``: `unit`, which is that of a hinge, or what it is where the joint, or
    the joint of the motor, slides; of a channel, its own, as far as that is known."""
    what, _, site = of.partition("@")
    if unit == CHANNEL:
        return channel_unit(spec.compile(), site) or unit
    if what in ELSEWHERE:
        return unit
    motor = spec.actuator(site)
    joint = spec.joint(motor.target if motor else site)
    if joint and joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        for turning, sliding in SLIDING.items():
            unit = unit.replace(turning, sliding)
    return unit


def to_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """Everything a report shows, in plain types; the same diagnosis gives the same bytes."""
    naming, location, evidence = diagnosis.naming, diagnosis.location, diagnosis.evidence
    return {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict,
        "answer": naming.answer,
        "answer_set": naming.answer_set,
        "confidence": naming.confidence,
        "members": [{p.name: p.values for p in member.placed} for member in naming.members],
        "runs": [run.name for run in diagnosis.recording.runs],
        "p": naming.p,
        "left": naming.left,
        "nameless": asdict(naming.stranger),
        "widened": naming.widened,
        "dispersion": naming.dispersion,
        "acts_in": diagnosis.acts_in,
        "location": {
            "sentence": location.sentence,
            "places": [asdict(place) for place in location.places],
            "modes": location.modes,
            "states": location.states,
        },
        "steps": [_step(step) for step in naming.steps],
        "parameters": parameter_rows(naming, diagnosis.recording),
        "evidence": {**asdict(evidence), "white": evidence.white},
    }


def _step(step: Step) -> dict[str, Any]:
    screened = [
        {
            "name": c.placed.name,
            "values": c.placed.values,
            "strength": c.strength,
            "z": c.z,
            "p": float(p),
            "concealment": c.concealment,
            "hidden": c.hidden,
        }
        for c, p in zip(step.screened, step.p, strict=True)
    ]
    refitted = [
        {
            "name": r.name,
            "weight": r.weight,
            "deviance": r.deviance,
            "converged": bool(r.fitted.converged),
            "held_out": float(r.judged.point.squares.sum()),
            "values": {p.name: p.values for p in r.placed},
        }
        for r in step.rivals
    ]
    return {"screened": screened, "refitted": refitted}
