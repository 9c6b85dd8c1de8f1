"""What may be said of each effect of a fit: its numbers with intervals, and whether it is certain."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy import stats

from fimpact.deciding import BELIEF, CONFIDENCE, NOTHING
from fimpact.effects.families.sensing import CHANNEL
from fimpact.recordings import FIELDS, Recording
from fimpact.selection.regression import Regression
from fimpact.smoothing.columns import columns
from fimpact.smoothing.parameters import Parameter
from fimpact.smoothing.smoother import Smoothed
from fimpact.support.channel_units import channel_unit

CERTAIN, POSSIBLE, SLIGHT = "certain", "possible", "small"
NAMELESS = "a smooth function explains more than twice as much, so that something else may stand behind it"
NO_FIT, HOLDS_NOTHING, SLIM = "the fit did not converge", "its interval holds nothing", "it is next to nothing"
UNSEEN = (NAMELESS, NO_FIT, HOLDS_NOTHING, SLIM)
RUNS = 2  # more than there are numbers: from there the spread from run to run is known
# Turns of what is no joint, though one may have the name of its site.
ELSEWHERE = ("inertia", "gravity_tilt", "ground_tilt", "misalignment")
SLIDING = {"(N m)": "N", "N m": "N", "kg m^2": "kg", "kg m²": "kg", "rad": "m"}


@dataclass(frozen=True)
class Finding:
    """One effect of the answer. rows: its numbers; why_not: the rule that keeps it from being certain, or None; seen:
    whether the data tell it from nothing, and from what has no name."""

    effect: str
    site: str
    tier: str
    rows: tuple[dict[str, Any], ...]
    why_not: str | None
    seen: bool = True

    @property
    def name(self) -> str:
        """``effect@site``."""
        return f"{self.effect}@{self.site}"


def parameter_rows(smoothed: Smoothed, recording: Recording) -> list[dict[str, Any]]:
    """One row for each number of a fit: name, of (the unknown or ``effect@site``), unit, before (the model's own value,
    None for an effect), after, and its 95 % interval low, high, robust to what correlates within a stretch, and with
    runs enough within a run."""
    half, spec = half_widths(smoothed), recording.spec()
    rows = []
    own = dict(zip([u.name for u in recording.unknowns], smoothed.track.simulator.theta, strict=True))
    for number, width in zip(smoothed.numbers, half, strict=True):
        unit = unit_at(spec, number.of, number.unit if number.place >= 0 else FIELDS[number.name][0])
        before = float(own[number.of]) if number.place < 0 else None
        low, high = number.value - width, number.value + width
        rows.append(
            {"name": number.name, "of": number.of, "unit": unit, "before": before, "after": number.value,
             "low": float(low), "high": float(high)}
        )  # fmt: skip
    return rows


def half_widths(smoothed: Smoothed) -> np.ndarray:
    """Half of the 95 % interval of each number, (p,), in its unit."""
    if not smoothed.numbers:
        return np.zeros(0)
    regression = Regression(smoothed, columns(smoothed, []))
    found = regression.solve(range(regression.p))
    by_stretch = _sd(regression.covariance(found))
    wide = by_stretch * stats.t.ppf((1 + CONFIDENCE) / 2, max(regression.count - 1, 1))
    runs = _run_of_stretch(regression)
    if len(np.unique(runs)) >= RUNS + regression.p:
        by_run = _sd(regression.covariance(found, runs))
        wide = np.maximum(wide, by_run * stats.t.ppf((1 + CONFIDENCE) / 2, len(np.unique(runs)) - 1))
    return wide * np.array([n.slope for n in smoothed.numbers])


def _sd(covariance: np.ndarray) -> np.ndarray:
    """Standard deviations, (p,); infinite where rounding has left no variance: nothing is known there."""
    own = np.diag(covariance)
    return np.where(own > 0, np.sqrt(np.maximum(own, 0.0)), np.inf)


def _run_of_stretch(regression: Regression) -> np.ndarray:
    track = regression.smoothed.track
    return np.array([track.run_of[np.argmax(regression.stretch == b)] for b in range(regression.count)])


def findings(
    smoothed: Smoothed, slight: frozenset[str], rows: list[dict[str, Any]], doubted: Sequence[str] = ()
) -> tuple[Finding, ...]:
    """What may be said of each effect; `slight`: names of small refinements; `doubted`: names that a smooth function
    without a name beats."""
    found = []
    for place, law in enumerate(smoothed.placed):
        own = [(n, r) for n, r in zip(smoothed.numbers, rows, strict=True) if n.place == place]
        own_rows = tuple(row for _, row in own)
        why = NAMELESS if law.name in doubted else _why_not(smoothed, place, own)
        tier = SLIGHT if own and law.usual else POSSIBLE if why else SLIGHT if law.name in slight else CERTAIN
        found.append(Finding(law.effect.name, law.site, tier, own_rows, why, why not in UNSEEN))
    return tuple(found)


def _why_not(smoothed: Smoothed, place: int, own: list[tuple[Parameter, dict]]) -> str | None:
    law, prior = smoothed.placed[place], smoothed.priors[place]
    if not smoothed.converged:
        return NO_FIT
    shapes = {c.name for c in law.effect.coefficients if c.shape}
    sizes = [(n, row) for n, row in own if n.name not in shapes]
    seen = [(n, row) for n, row in sizes if not row["low"] <= law.effect.neutral[n.name] <= row["high"]]
    if not seen:
        return HOLDS_NOTHING
    if all(abs(n.value) < NOTHING * prior.get(n.name, 0.0) for n, _ in seen):
        return SLIM
    if any(n.at_bound and n.value for n, _ in own):
        return "a value lies at its bound"
    off = [n for n, _ in seen if abs(n.value - law.effect.neutral[n.name]) > BELIEF * prior.get(n.name, np.inf)]
    if off and law.effect.linear:
        return f"its {off[0].name} is larger than such parts have: something else may stand behind it"
    return None


def numbers_worth_telling(finding: Finding) -> list[dict[str, Any]]:
    """The numbers of an effect that its intervals tell from nothing, and that are something beside the largest."""
    most: dict[str, float] = {}
    for row in finding.rows:
        most[row["unit"]] = max(abs(row["after"]), most.get(row["unit"], 0.0))
    seen = [row for row in finding.rows if not row["low"] <= 0 <= row["high"]]
    return [row for row in seen if abs(row["after"]) >= NOTHING * most[row["unit"]]]


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
