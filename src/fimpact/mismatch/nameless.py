"""Nameless: is there a force, or an error of a sensor, that no effect of the catalogue gives, as a smooth curve over
state, time, command or reading, or for a moment, or now and then; or an effect that is there, but not alike in all
runs?

All windows are asked, those held out included, but for what differs from run to run: in another regime what a relative
of the truth had imitated shows.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from fimpact.effects.base import Effect, Placed, words
from fimpact.mismatch.calibrate import adjusted_groups, background
from fimpact.mismatch.curves import bumps, curves, field, spells, waves
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.pooled import refitted, stacked
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import Pulses
from fimpact.mismatch.score import Candidate, rescore, scores

NAMELESS = Placed(
    Effect("nameless", "residual", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], np.zeros_like, {}),
    "",
    {},
)
What = tuple[str | float, ...]  # what fills the gaps of one of these: a joint, a channel, an effect, seconds
WORDS = {
    "speed": "a force on {} that goes with its speed",
    "position": "a force on {} that goes with its position",
    "time": "a force on {} that goes with the time since a run began",
    "friction over position": "dry friction of {} that goes with its position",
    "friction over time": "dry friction of {} that goes with the time since a run began",
    "commands": "a force on {} that goes with the commands",
    "command over position": "an effect of the command on {} that goes with its position",
    "command over time": "an effect of the command on {} that goes with the time since a run began",
    "spell": "a force for a moment, about {:.2g} s after a run began",
    "wave": "a force on {} that comes and goes every {:.2g} s",
    "command wave": "an effect of the command on {} that comes and goes every {:.2g} s",
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
    bench: Bench, explanation: Explanation, fitted: Fit, found: Pulses, candidates: Sequence[Candidate]
) -> Stranger:
    """Any of the `curves`, `waves`, `spells`, `field` and `readings` and whatever varies among the `candidates`, beside
    what `explanation` says; p is 1 where nothing can be asked.

    Args:
        fitted: the explanation in all windows (`pooled`), in units in which disturbances are white. found: pulses in
            them.
    """
    groups: dict[tuple[str, What], list[np.ndarray]] = {}
    asked = list(_columns(bench, explanation, found))
    told = scores(fitted, [NAMELESS] * len(asked), [column for *_, column in asked])
    for (kind, what, _), candidate in zip(asked, told, strict=True):
        if candidate.information > 0:
            groups.setdefault((kind, what), []).append(candidate.column.ravel())
    stacks = {name: np.stack(group, 1) for name, group in groups.items()}
    stacks |= varying(bench.training, fitted, candidates)
    if not stacks:
        return Stranger(1.0, 0.0, "")
    left = refitted(fitted)
    residual, behind = left.linear.off(left.point.residual).ravel(), background(left, found)
    p, gain, size = adjusted_groups(list(stacks.values()), residual, behind)
    first = np.lexsort((-size, p))[0]
    kind, what = list(stacks)[first]
    return Stranger(float(p[first]), float(gain[first]), WORDS[kind].format(*what))


def _columns(bench: Bench, explanation: Explanation, found: Pulses) -> Iterator[tuple[str, What, np.ndarray]]:
    """What it goes with, a key of `WORDS`, what fills the gaps there, as a joint or channel, and the sensitivity to one
    such curve, (w, m)."""
    channels = bench.training.simulator.recording.channels
    for dof, kind, curve in curves(found):
        yield kind, (found.dofs[dof],), found.along(dof, curve)
    for dof, kind, period, curve in waves(found):
        yield kind, (found.dofs[dof], period), found.along(dof, curve)
    for seconds, column in spells(found):
        yield "spell", (seconds,), column
    for column in field(found):
        yield "field", (), column
    for channel, column in readings(bench, explanation):
        yield "reading", (channels[channel],), column


def varying(problem: Problem, fitted: Fit, candidates: Sequence[Candidate]) -> dict[tuple[str, What], np.ndarray]:
    """Sensitivities, (w m, runs - 1), to the differences of each effect between training runs: what is alike in all is
    none, and neither is what the coordinates do there. Training windows are the first of those of `fitted`, and
    candidates are known in them only."""
    learned, size = len(problem.windows.runs), fitted.point.residual.shape
    best: dict[str, Candidate] = {}
    rest = np.zeros((size[0] - learned, size[1]))
    whole = [replace(candidate, change=stacked(candidate.change, rest)) for candidate in candidates]
    for candidate in sorted(rescore(fitted, whole), key=lambda c: -c.gain):
        best.setdefault(candidate.placed.name, candidate)
    coordinates = np.linalg.qr(fitted.linear.projected[:learned].reshape(learned * size[1], -1))[0]
    found = {}
    for name, candidate in best.items():
        own = candidate.column[:learned]
        apart = differences(own, problem.windows.runs)
        if apart.shape[1]:
            alone = _off(coordinates, own.reshape(-1, 1))
            apart = _off(alone / max(np.linalg.norm(alone), 1e-300), _off(coordinates, apart))
            found["varying", (words(name),)] = np.pad(apart, [(0, rest.size), (0, 0)])
    return found


def _off(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """`columns`, (m, c), without what the orthonormal `basis`, (m, k), imitates."""
    return columns - basis @ (basis.T @ columns)


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
