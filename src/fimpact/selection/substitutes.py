"""What could stand in the place of each effect that is in, by the algebra of one regression.

Forward selection never asks again what an early round answered, though later rounds may have made another answer
likelier; and what is as likely is the set. An exchange of one for one, as in exact designs (Fedorov 1972), or of two
for one: what two stand-ins do together may be the work of one effect, which neither of them alone has made room for.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fimpact.deciding import UNLIKELY
from fimpact.effects.base import Placed
from fimpact.selection.chance import least
from fimpact.selection.options import Option
from fimpact.selection.regression import Estimate, Regression, inverse

NOTHING = "nothing"  # in place of an effect


@dataclass(frozen=True)
class Exchange:
    """An option in place of the effects number `places`; weight: its marginal likelihood beside that of what is in;
    sure: whether it is simpler, by fewer numbers or by fewer effects that have no more, or predicts stretches better
    that were not fitted, beyond chance; better: by how much it does, in squared innovations."""

    places: tuple[int, ...]
    option: Option
    estimate: Estimate
    weight: float
    sure: bool
    better: float


@dataclass(frozen=True)
class Alternative:
    """An explanation in place of the last one chosen, refitted: its effects, the unknowns with them, (p,), and its
    weight beside the answer's 1."""

    placed: tuple[Placed, ...]
    theta: np.ndarray
    weight: float


def exchanges(
    regression: Regression,
    offered: Sequence[Option],
    beside: Sequence[Option] | None = None,
    leaving: Sequence[tuple[int, ...]] | None = None,
) -> list[Exchange]:
    """What is as likely in place of an effect that is in, nothing too, likeliest first, one choice of shapes a name.

    Args:
        beside: what may stand beside all that is in, default: all of `offered`. leaving: effects, by number, that may
            go together, default: each alone.
    """
    present = regression.solve(range(regression.p))
    now, errors = regression.evidence(present), regression.errors(present)
    singles = [Option(NOTHING, 0, ()), *(option for option in offered if len(option.members) == 1)]
    best: dict[tuple[tuple[int, ...], str], Exchange] = {}
    together = _beside(regression, present.kept, offered if beside is None else beside)
    added = {option.members: evidence for option, _, evidence in together}
    for places in leaving if leaving is not None else [(i,) for i in range(len(regression.smoothed.placed))]:
        without = regression.without(places)
        base = [i for i, n in enumerate(regression.smoothed.numbers) if n.place not in places]
        for option, columns, evidence in _beside(without, base, singles):
            if option.members and evidence < added.get(option.members, -np.inf):
                continue  # it does no other's work: beside what is in it is likelier
            weight = float(np.exp(min(evidence - now, 700.0)))
            known = best.get((places, option.name))
            if weight > max(UNLIKELY, known.weight if known else 0.0) or not option.members:
                found = without.solve([*base, *columns])
                better = errors - without.errors(found)
                if not (option.members or regression.white) and least(-better) <= 0:  # what is in may be worth nothing
                    weight = max(weight, 1.0)
                simpler = len(base) + len(columns) < regression.p + (len(places) > len(option.members))
                sure = bool(simpler or least(better) > 0)
                best[places, option.name] = Exchange(places, option, found, weight, sure, float(better.sum()))
    return sorted(best.values(), key=lambda e: -e.weight)


def _beside(
    regression: Regression, base: Sequence[int], offered: Sequence[Option]
) -> Iterator[tuple[Option, list[int], float]]:
    """Each option that has no forbidden sign beside the numbers `base`, its columns, and its evidence."""
    found = regression.solve(base)
    known, rest = regression.evidence(found), np.arange(regression.p, regression.gram.shape[1])
    held = np.array(base, int)
    whole = regression.gram.sum(0) / regression.dispersion + np.diag(regression.weight)
    right = regression.right.sum(0) / regression.dispersion + regression.pull
    across = whole[np.ix_(rest, held)]
    inner = whole[np.ix_(rest, rest)] - across @ inverse(whole[np.ix_(held, held)]) @ across.T
    left = right[rest] - across @ found.values
    for option in offered:
        own = [i for member in option.members for i in regression.columns.of(member)]
        if option.members and not own:
            continue
        block = inner[np.ix_(own, own)]
        values = np.linalg.solve(block, left[own])
        if not (regression.positive[rest[own]] & (values < 0)).any():
            yield option, list(rest[own]), known + 0.5 * float(left[own] @ values - np.linalg.slogdet(block)[1])
