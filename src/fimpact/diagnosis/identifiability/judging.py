"""Judge from information alone what data of that kind cannot show.

One rule for all: an effect of its usual size, one prior sd, is not shown by data that leave another explanation more
than `UNLIKELY` of its likelihood. Where that other one is nothing, it stays unseen; where it is an effect, and this
holds both ways, the two cannot be told apart. Whatever is fitted anyway may take up its share.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fimpact.deciding import UNLIKELY

NEEDED = -2 * np.log(UNLIKELY)  # squares by which a rival must fit worse


@dataclass(frozen=True)
class Asked:
    """A parameter that the case frees (`free`), ``field@site``, or an effect, ``effect@site``. columns: its own in the
    information. order: in which engineers suspect, `Effect.order`."""

    name: str
    free: bool
    order: int
    columns: tuple[int, ...]

    @property
    def kind(self) -> str:
        """What it is, without its place."""
        return self.name.partition("@")[0]

    @property
    def site(self) -> str:
        """Where it sits."""
        return self.name.partition("@")[2]


@dataclass(frozen=True)
class Judged:
    """unseen: what the data do not show, with the squares by which it shows. alike: groups, of two or more names, of
    which each passes for another of its group. swallowed: what no other one, but all that is fitted together takes up.
    posing: pairs of which the first passes for the second, and the second is too large to pass for the first.
    """

    unseen: dict[str, float]
    alike: tuple[tuple[str, ...], ...]
    swallowed: tuple[str, ...] = ()
    posing: tuple[tuple[str, str], ...] = ()


class Judge:
    """Judges `asked` by its `information`, (k, k), of columns in units of their prior sd; known: weight of the priors,
    (k,), 1 or, where there is none, 0."""

    def __init__(self, information: np.ndarray, known: np.ndarray, asked: Sequence[Asked]):
        self.information, self.known, self.asked = information, known, tuple(asked)
        self.fitted = [own for own in self.asked if own.free]

    def with_more(self, information: np.ndarray) -> "Judge":
        """The same with further data."""
        return Judge(self.information + information, self.known, self.asked)

    def longer(self) -> "Judge":
        """The same with as much again of the same data."""
        return self.with_more(self.information)

    def judged(self) -> Judged:
        """Judge everything: what is unseen alone, and of the rest what passes for something else."""
        alone = {own.name: self.shows(own) for own in self.asked}
        unseen = {name: size for name, size in alone.items() if size < NEEDED}
        seen = [own for own in self.asked if own.name not in unseen]
        taken = {own.name: self.taken_up(own) for own in seen if self._open(own) < NEEDED}
        pairs = [(name, other.name) for name, other in taken.items() if other]
        alike, posing = self._pairs([own for own in seen if not own.free and own.name not in taken])
        pairs += alike
        groups = _groups(pairs, [own.name for own in self.asked])
        joined = {name for group in groups for name in group}
        return Judged(unseen, groups, tuple(name for name in taken if name not in joined), tuple(posing))

    def parted(self, names: Sequence[str]) -> list[tuple[str, ...]]:
        """These names by groups that cannot be told apart; what is not seen, or swallowed, is in none."""
        found = self.judged()
        groups = [tuple(name for name in own if name in names) for own in found.alike]
        gone = {name for own in groups for name in own} | set(found.unseen) | set(found.swallowed)
        return [own for own in groups if own] + [(name,) for name in names if name not in gone]

    def clear(self, one: Asked) -> bool:
        """Whether it is seen, whatever is fitted anyway."""
        return self.shows(one) >= NEEDED and self._open(one) >= NEEDED

    def taken_up(self, one: Asked) -> Asked | None:
        """The one number, seen itself, that is fitted anyway and alone takes `one` up."""
        fitted = [own for own in self.fitted if own is not one and self.shows(own) >= NEEDED]
        left = [self.shows(one, own.columns) for own in fitted]
        return fitted[int(np.argmin(left))] if min(left, default=np.inf) < NEEDED else None

    def _open(self, one: Asked) -> float:
        """Squares by which it shows once all that is fitted anyway has taken its share."""
        return self.shows(one, [c for own in self.fitted if own is not one for c in own.columns])

    def shows(self, one: Asked, beside: Sequence[int] = ()) -> float:
        """Squares by which `one` of its usual size shows once the columns `beside` have taken up what they can."""
        own, beside = list(one.columns), list(beside)
        left = self.information[np.ix_(own, own)]
        if beside:
            left = left - self._taken(self.information, beside, own)
        return float(np.diag(left).max(initial=0.0))

    def poses(self, one: str, other: str) -> bool:
        """Whether `other`, of a plausible size, passes for `one` of its usual size."""
        known = {own.name: own for own in self.asked}
        fitted = [c for own in self.fitted for c in own.columns]
        return self.shows(known[one], [*fitted, *known[other].columns]) < NEEDED

    def _pairs(self, tried: Sequence[Asked]) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
        """Pairs of which each, of a plausible size, passes for the other of its usual size; and those of which one."""
        fitted, every = [c for own in self.fitted for c in own.columns], list(range(len(self.information)))
        left = self.information - self._taken(self.information, fitted, every) if fitted else self.information
        passes = np.zeros((len(tried), len(tried)), bool)
        for j, other in enumerate(tried):
            beside = list(other.columns)
            rest = np.diag(left - self._taken(left, beside, every))
            passes[:, j] = [rest[list(one.columns)].max(initial=0.0) < NEEDED for one in tried]
        np.fill_diagonal(passes, False)
        both, one = np.argwhere(np.triu(passes & passes.T)), np.argwhere(passes & ~passes.T)
        alike, posing = ([(tried[i].name, tried[j].name) for i, j in found] for found in (both, one))
        return alike, posing

    def _taken(self, information: np.ndarray, beside: list[int], own: list[int]) -> np.ndarray:
        """What columns `beside` take of the information on others, (own, own)."""
        inner = information[np.ix_(beside, beside)] + np.diag(self.known[beside])
        scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
        cross = information[np.ix_(beside, own)] / scale[:, None]
        return cross.T @ np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-12, hermitian=True) @ cross


def _groups(pairs: Sequence[tuple[str, str]], names: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Names that pairs join, each group in the order of `names`."""
    group = {name: {name} for name in names}
    for one, other in pairs:
        joined = group[one] | group[other]
        for name in joined:
            group[name] = joined
    found = dict.fromkeys(tuple(name for name in names if name in own) for own in group.values())
    return tuple(own for own in found if len(own) > 1)
