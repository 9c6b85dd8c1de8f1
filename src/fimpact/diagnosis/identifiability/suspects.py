"""What would be suspected first, each as columns of force along a motion, in units of its usual size."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from fimpact.diagnosis.identifiability.judging import Asked
from fimpact.diagnosis.identifiability.motion_model import EditedCopy, Motion, setter, stacked
from fimpact.effects.base import MOTOR, Effect, Placed, Scales
from fimpact.smoothing.candidates import Candidate, at
from fimpact.smoothing.parameters import Parameter, parameters

Choice = TypeVar("Choice")


@dataclass(frozen=True)
class Suspect:
    """One parameter that the case frees, or one effect at one place. makers: of each of its columns what makes it, and
    its usual size in units of that. others: other sizes of what is not proportional to its size. order: in which
    engineers suspect; -1 of a parameter."""

    name: str
    order: int
    makers: tuple[tuple[Placed | Parameter, float], ...]
    others: tuple[Placed, ...] = ()

    @property
    def free(self) -> bool:
        """Whether the case frees it."""
        return self.order < 0


def first_suspects(catalogue: Iterable[Effect]) -> list[Effect]:
    """What is asked for by itself: neither compounds, nor refinements within a family, nor what only contact shows, nor
    what has no usual size: limits, which are far away or are not."""
    families = {effect.name: effect.family for effect in catalogue}
    return [
        effect
        for effect in catalogue
        if not effect.contains
        and not effect.touching
        and np.isfinite(list(effect.neutral.values())).all()
        and effect.family not in {families.get(name) for name in effect.refines}
    ]


def suspects(catalogue: Iterable[Effect], motion: Motion, scales: Scales) -> list[Suspect]:
    """The case's own unknowns, then rigid bodies, friction and motors; of two names for the same numbers of the model,
    the first."""
    track = motion.track
    found = [unknown(number) for number in parameters(track.simulator, track.simulator.theta, (), ())]
    for effect in sorted(first_suspects(list(catalogue)), key=lambda own: own.order):
        for site in effect.sites(track.model, track.recording.channels) if effect.order <= MOTOR else ():
            found += of_choices(effect, at(effect, site, track.model, scales))
    return without_twins(found, motion.bench)


def columns(asked: Iterable[Suspect], motion: Motion) -> tuple[list[Asked], np.ndarray]:
    """The suspects that are forces along a motion, and their columns, (N, nv, k), in units of their usual size."""
    kept: list[Asked] = []
    parts: list[np.ndarray | None] = []
    for own in asked:
        made = [force for maker, _ in own.makers if (force := _made(maker, motion)) is not None]
        if len(made) < len(own.makers) or not all(np.isfinite(force).all() for force in made):
            continue
        places = tuple(range(len(parts), len(parts) + len(made)))
        parts += [force * size for force, (_, size) in zip(made, own.makers, strict=True)]
        kept.append(Asked(own.name, own.free, own.order, places))
    return kept, stacked(parts, motion.qvel) if parts else np.zeros((*motion.qvel.shape, 0))


def other_sizes(asked: Iterable[Suspect], motion: Motion) -> np.ndarray:
    """Columns, (N, nv, m), of the sizes that are not asked: what is left of a motion must not be what comes later than
    the one size that is."""
    made = [motion.of_effect(own) for suspect in asked for own in suspect.others]
    parts: list[np.ndarray | None] = [own for own in made if own is not None and np.isfinite(own).all()]
    return stacked(parts, motion.qvel) if parts else np.zeros((*motion.qvel.shape, 0))


def unknown(number: Parameter) -> Suspect:
    """A parameter that the case frees."""
    size = number.spread if np.isfinite(number.spread) else 1.0 if number.log else number.size
    return Suspect(number.of, -1, ((number, float(size)),))


def of_choices(effect: Effect, choices: Sequence[Candidate]) -> list[Suspect]:
    """All choices of its shapes; of an effect that is not proportional to its size, the middle one."""
    if not choices:
        return []
    chosen = of_usual_size(effect, choices)
    makers = []
    for own in chosen:
        for k in range(len(own.names)):
            small = 1e-2 if effect.linear else 1.0
            values = [0.0] * len(own.names)
            values[k] = small * own.sd[k]
            makers.append((own.placed(values), 1 / small))
    others = tuple(own.placed([0.0] * len(own.names)) for own in choices if own not in chosen)
    return [Suspect(chosen[0].name, effect.order, tuple(makers), others)]


def of_usual_size(effect: Effect, choices: Sequence[Choice]) -> Sequence[Choice]:
    """All choices of its shapes; of an effect that is not proportional to its size, the middle one."""
    return choices if effect.linear else [choices[len(choices) // 2]]


def _made(maker: Placed | Parameter, motion: Motion) -> np.ndarray | None:
    return motion.of_effect(maker) if isinstance(maker, Placed) else motion.of_number(maker)


def without_twins(found: Sequence[Suspect], bench: EditedCopy) -> list[Suspect]:
    """Of several that change the same numbers of the model, the first."""
    kept, known = [], set()
    for own in found:
        numbers = frozenset().union(*(_numbers(maker, bench) for maker, _ in own.makers))
        if not numbers or numbers not in known:
            kept.append(own)
        known.add(numbers)
    return kept


def _numbers(maker: Placed | Parameter, bench: EditedCopy) -> frozenset[tuple[str, int]]:
    if isinstance(maker, Parameter):
        return bench.numbers(setter(maker))
    if maker.effect.enters != "model":
        return frozenset()
    return bench.numbers(lambda model: maker.effect.law(model, maker.site, **maker.values))
