"""What the recordings of a diagnosis could not show of all that its search asked."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from fimpact.diagnosis.identifiability.judging import Asked, Judge
from fimpact.diagnosis.identifiability.motion_model import EditedCopy
from fimpact.diagnosis.identifiability.quick_look import Sight, look
from fimpact.diagnosis.identifiability.sentences import Told, findings_to_tell
from fimpact.diagnosis.identifiability.suspects import first_suspects, of_choices, of_usual_size, unknown, without_twins
from fimpact.recordings import Recording
from fimpact.selection.regression import Regression
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.parameters import Parameter


def not_shown(recording: Recording, asked: Regression, rivals: Collection[str] = ()) -> tuple[Told, ...]:
    """What the recordings cannot show or tell apart, beside what is in the model by now.

    Args:
        asked: columns beside the final fit. rivals: ``effect@site`` of the answer and of what
            the search itself could not tell from it, which is told elsewhere.
    """
    found = look(recording)
    sight = found if isinstance(found, Sight) else None
    judge = _judge(asked, _still(sight) if sight else set())
    judged = judge.judged()
    alike = tuple(group for group in judged.alike if not set(group) <= set(rivals))
    return tuple(findings_to_tell(replace(judged, alike=alike), judge.asked, sight))


def _still(sight: Sight) -> set[str]:
    """What does nothing along the recorded motion: where a joint stands still, columns are made of noise."""
    return {own.name for own in sight.judge.asked if not sight.judge.shows(own)}


def _judge(regression: Regression, still: set[str]) -> Judge:
    numbers, candidates = regression.smoothed.numbers, regression.columns.candidates
    size = np.array([*map(_unit, numbers), *(1.0 for _ in regression.columns.owners)])
    information = regression.gram.sum(0) * np.outer(size, size) / regression.dispersion
    known = np.array([*(float(np.isfinite(n.spread)) for n in numbers), *(1.0 for _ in regression.columns.owners)])
    fitted: dict[str, list[int]] = {}
    for column, number in enumerate(numbers):
        fitted.setdefault(number.of, []).append(column)
    asked = [Asked(name, True, -1, tuple(columns)) for name, columns in fitted.items()]
    for name, (order, members) in _tried(candidates, numbers, regression).items():
        columns = [regression.p + c for i in members for c in regression.columns.of(i)]
        asked.append(Asked(name, False, order, () if name in still else tuple(columns)))
    return Judge(information, known, asked)


def _tried(
    candidates: Sequence[Candidate], numbers: Sequence[Parameter], regression: Regression
) -> dict[str, tuple[int, list[int]]]:
    """Order and candidates, by number, of each effect at each place that is asked for by itself and is no parameter."""
    places: dict[str, list[int]] = {}
    for i, own in enumerate(candidates):
        places.setdefault(own.name, []).append(i)
    suspected = {effect.name for effect in first_suspects([own.effect for own in candidates])}
    held = {f"{part}@{law.site}" for law in regression.smoothed.placed for part in law.effect.contains}
    chosen = {n: own for n, own in places.items() if candidates[own[0]].effect.name in suspected and n not in held}
    every = [unknown(n) for n in numbers if n.place < 0]
    for rows in chosen.values():
        every += of_choices(candidates[rows[0]].effect, [candidates[i] for i in rows])
    bench = EditedCopy(regression.smoothed.linear.plant.model)
    kept = {one.name for one in without_twins(every, bench) if not one.free}
    found = {}
    for name, rows in chosen.items():
        if name in kept:
            effect, usual = candidates[rows[0]].effect, of_usual_size(candidates[rows[0]].effect, rows)
            found[name] = effect.order, list(usual)
    return found


def _unit(number: Parameter) -> float:
    """A coordinate's usual size: its prior sd, else all of it."""
    return float(number.spread if np.isfinite(number.spread) else 1.0 if number.log else number.size)
