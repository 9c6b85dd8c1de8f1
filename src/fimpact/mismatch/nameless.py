"""Nameless: is there a force, or an error of a sensor, that no effect of the catalogue gives, as a smooth curve over
state, time, command or reading; or an effect that is there, but not alike in all runs?

All windows are asked, those held out included: in another regime what a relative of the truth had imitated shows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from fimpact.effects.base import Effect, Placed, words
from fimpact.mismatch.calibrate import adjusted_groups, background
from fimpact.mismatch.colour import coloured
from fimpact.mismatch.curves import bumps, curves, field
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.pooled import pooled, stacked
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.score import Candidate, rescore, score

NAMELESS = Placed(
    Effect("nameless", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], np.zeros_like, {}),
    "",
    {},
)


WORDS = {
    "speed": "a force on {} that goes with its speed",
    "position": "a force on {} that goes with its position",
    "time": "a force on {} that goes with the time since a run began",
    "friction over position": "dry friction of {} that goes with its position",
    "friction over time": "dry friction of {} that goes with the time since a run began",
    "commands": "a force on {} that goes with the commands",
    "command over position": "a gain of what drives {} that goes with its position",
    "command over time": "a gain of what drives {} that goes with the time since a run began",
    "swing": "something that swings unseen and pulls {} along",
    "contact": "a force on {} while in contact",
    "contact over position": "a force on {} while in contact that goes with its position",
    "reading": "an error of {} that bends with what it reads",
    "field": "a force that goes with posture, of all joints together",
    "varying": "{}, of a strength that differs from run to run",
}


@dataclass(frozen=True)
class Stranger:
    """The strongest of what has no name: family-wise p, predicted gain, and what it is like in words."""

    p: float
    gain: float
    like: str


def nameless(
    bench: Bench, explanation: Explanation, found: Pulses, held_out: Pulses, candidates: Sequence[Candidate]
) -> Stranger:
    """Any of the `curves`, `field` and `readings` and whatever varies among the `candidates`, beside what `explanation`
    says; p is 1 where nothing can be asked."""
    fitted, pulses = pooled(bench, explanation, found, held_out)
    fitted, groups = coloured(fitted, pulses), {}
    channels = bench.training.simulator.recording.channels
    columns = [(WORDS[name].format(pulses.dofs[dof]), pulses.along(dof, curve)) for dof, name, curve in curves(pulses)]
    columns += [(WORDS["field"], column) for column in field(pulses)]
    columns += [(WORDS["reading"].format(channels[i]), column) for i, column in readings(bench, explanation)]
    for like, column in columns:
        candidate = score(fitted, NAMELESS, column)
        if candidate.information > 0:
            groups.setdefault(like, []).append(candidate.column.ravel())
    stacks = {like: np.stack(group, 1) for like, group in groups.items()}
    stacks |= varying(bench.training, fitted, candidates)
    if not stacks:
        return Stranger(1.0, 0.0, "")
    p, gain = adjusted_groups(list(stacks.values()), refitted(fitted).ravel(), background(fitted, pulses))
    first = np.lexsort((-gain, p))[0]
    return Stranger(float(p[first]), float(gain[first]), list(stacks)[first])


def refitted(fitted: Fit) -> np.ndarray:
    """The residual, (w, m), less what all windows together would have the coordinates take of it."""
    linear, left = fitted.linear, fitted.linear.off(fitted.point.residual)
    slope = np.einsum("wma,wm->a", linear.projected, left) - fitted.pull
    return left - linear.projected @ (fitted.covariance @ slope)


def varying(problem: Problem, fitted: Fit, candidates: Sequence[Candidate]) -> dict[str, np.ndarray]:
    """Sensitivities, (w m, runs - 1), to the differences of each effect between training runs: what is alike in all is
    none. Training windows are the first of those of `fitted`, and candidates are known in them only."""
    best: dict[str, Candidate] = {}
    runs, size = problem.windows.runs, fitted.point.residual.shape
    rest = np.zeros((size[0] - len(runs), size[1]))
    whole = [replace(candidate, change=stacked(candidate.change, rest)) for candidate in candidates]
    for candidate in sorted(rescore(fitted, whole), key=lambda c: -c.gain):
        best.setdefault(candidate.placed.name, candidate)
    runs, learned = np.append(runs, np.full(len(rest), -1)), np.arange(size[0])[:, None] < len(runs)
    apart = {n: differences(np.where(learned, c.column, 0.0), runs) for n, c in best.items()}
    return {WORDS["varying"].format(words(name)): columns for name, columns in apart.items() if columns.shape[1]}


def differences(column: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Columns (w m, runs - 1), across `column` (w, m), that it is made of when each of its `runs`, (w,), has a strength
    of its own."""
    shown = [run for run in np.unique(runs) if np.any(column[runs == run])]
    apart = np.stack([np.where(runs[:, None] == run, column, 0.0).ravel() for run in shown], 1)
    size = np.linalg.norm(apart, axis=0)
    return apart / size @ null_space(size[None])


def readings(bench: Bench, explanation: Explanation) -> list[tuple[int, np.ndarray]]:
    """(channel, sensitivity (w, m) in all windows) of errors of each channel that are smooth bumps over its range."""
    problems, out = (bench.training, bench.held_out), []
    # Not over what was measured, which its own noise would be found in.
    predicted = [_predicted(p, part) for p, part in zip(problems, explanation.parts, strict=True)]
    for channel in range(predicted[0].shape[2]):
        own = [p[:, :, channel] for p in predicted]
        for bump in bumps(np.concatenate([p.ravel() for p in own])):
            errors = np.split(bump, [own[0].size])
            parts = (_misread(p, channel, e.reshape(o.shape)) for p, e, o in zip(problems, errors, own, strict=True))
            out.append((channel, stacked(*parts)))
    return out


def _predicted(problem: Problem, part: Fit) -> np.ndarray:
    point = part.point
    return problem.simulator.predict(point.hypothesis, problem.windows, point.qpos, point.qvel)


def _misread(problem: Problem, channel: int, error: np.ndarray) -> np.ndarray:
    """What an `error` of one channel, (w, T), is in units of noise, (w, m)."""
    whole = np.zeros(problem.windows.measured.shape)
    whole[:, :, channel] = error
    return problem.extend(problem.whiten(whole)[..., None])[..., 0]
