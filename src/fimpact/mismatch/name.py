"""Name: which effect, where, and which others the recordings cannot tell from it.

Screen every candidate by its score, refit the best few to convergence, compare what they predict, held-out runs
included; add the best, ask again, drop what became superfluous.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from fimpact.effects.base import Effect
from fimpact.mismatch.accept import TRACE, TRIES, accepted, beats, hopeful, worthwhile
from fimpact.mismatch.colour import colour, coloured
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.explain import Explanation, naive_fit, sharpened, without
from fimpact.mismatch.fit import lost
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.nameless import nameless
from fimpact.mismatch.naming import LARGEST, Naming
from fimpact.mismatch.pooled import pooled
from fimpact.mismatch.pulses import Pulses, pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, screen
from fimpact.mismatch.step import ALARM, Search, Step, step, together
from fimpact.mismatch.tame import WILD, tamed
from fimpact.mismatch.weigh import both, explained, members, weigh, widened

SUSPECT = 0.05  # family-wise p up to which a name is asked for where something without one is there for certain
SWAPS = 2  # candidates that are refitted in the place of an effect that is there already


def name(bench: Bench, effects: Sequence[Effect], progress: Callable[[str], None] = print) -> Naming:
    """Find what is missing from the naive model of the recording behind `bench`."""
    naive = naive_fit(bench)
    tried = proposals(effects, bench.training, scales(bench.training, naive.fitted.point))
    progress(f"screening {len(tried)} candidates")
    found = pulses(bench.training, naive.fitted), pulses(bench.held_out, naive.judged)
    naive = sharpened(bench, found[0], naive)
    search = Search(bench, tuple(screen(bench.training, naive.fitted, tried)), *found, progress)
    return answered(search, naive)


def answered(search: Search, naive: Explanation) -> Naming:
    """The answer. Where what has no name is there for certain, that something is missing is no longer the question, but
    which: a name is asked for that alone could be chance."""
    answer = _answer(search, naive, *build(search, naive))
    asked = answer.certain and ALARM < answer.p <= SUSPECT
    return _answer(search, naive, *build(search, naive, SUSPECT)) if asked else answer


def build(
    search: Search, naive: Explanation, alarm: float = ALARM
) -> tuple[list[Step], Explanation, list[Explanation]]:
    """Add the best effect and ask again, for as long as that is worthwhile and new: every round, the explanation they
    end with, and its rivals.

    Args:
        alarm: family-wise p up to which a first effect is asked for.
    """
    best, rivals, steps, known = naive, [], [], {naive.name}
    while len(best.placed) < LARGEST:
        steps.append(step(search, best, TRACE * _learned(search, naive, best), alarm=alarm))
        found = _further(search, naive, best, steps[-1], known)
        if not found and _astray(steps[-1], best) and len(best.placed) + 2 <= LARGEST:
            paired = together(search, best, steps[-1])
            found = _further(search, naive, best, paired, known)
            steps[-1] = paired if found else steps[-1]
        if not found:
            break
        best, rivals = found
        known.add(best.name)
    return steps, best, rivals[1:]


def _astray(last: Step, best: Explanation) -> bool:
    """Whether there are rivals, and neither `best` nor they come near the noise: what one of them mends, another may
    still spoil."""
    return bool(last.rivals) and (lost(best.fitted.point) or last.rivals[0].loudness > WILD)


def _learned(search: Search, naive: Explanation, best: Explanation) -> float:
    """Generalised squares by which `best` fits the training windows better than the naive model."""
    shade = colour(search.pulses, disturbance(best.fitted, search.pulses))
    return explained([shade], [naive.fitted], [best.fitted])


def _further(search: Search, naive: Explanation, best: Explanation, last: Step, known: set[str]):
    """The first of a round's rivals that serves, and the rivals from there on; None if none does. What is as large as
    it may be stands in for something else, and is asked after all others."""
    groups = [[r for r in last.rivals if any(p.at_limit for p in r.placed) is limited] for limited in (False, True)]
    if not all(groups):
        return _serving(search, naive, best, last, known)
    found = (_serving(search, naive, best, replace(last, rivals=search.ranked(g)), known) for g in groups)
    return next(filter(None, found), None)


def _serving(search: Search, naive: Explanation, best: Explanation, last: Step, known: set[str]):
    """The first of a round's rivals that is worthwhile and new, does something and keeps its word, and the rivals from
    there on; None if there is none."""
    asked = hopeful(best, last.rivals)
    for first in range(min(len(asked), TRIES)):
        ranked = search.ranked(asked[first:]) if first else last.rivals
        if not worthwhile(search, naive, best, replace(last, rivals=ranked)):
            if ranked[0].loudness <= WILD:
                return None
            continue  # where nothing is near the noise, what one step promises is no order to rely on
        for answers in _asked(search, best, ranked):
            if answers[0].name in known or not beats(search, answers[0], best):
                return None  # it was the best before: from here on names would take turns for ever
            found = accepted(search, best, answers[0])
            if found:
                return found, answers
    return None


def _asked(search: Search, best: Explanation, ranked: list[Explanation]) -> Iterator[list[Explanation]]:
    """What is asked in turn in the place of `ranked`: that reconsidered and, for a surrogate that promised more and
    does not keep it gives the place back, as it was; between them, where nothing is near the noise, what does not lead
    and really predicts better."""
    if len(ranked[0].placed) > 1:
        again = _reconsider(search, ranked)
        yield again
        better = hopeful(best, again) if ranked[0].loudness > WILD else []
        for first in range(1, min(len(better), TRIES)):
            yield search.ranked(better[first:])
    yield ranked


def _reconsider(search: Search, rivals: list[Explanation]) -> list[Explanation]:
    """Each effect in turn left out and asked for anew: what is superfluous goes, a surrogate gives way."""
    bench = search.bench
    for leaving in rivals[0].placed:
        rest = tuple(p for p in rivals[0].placed if p.name != leaving.name)
        if len(rest) == len(rivals[0].placed):
            continue  # another leads by now, which does without it
        reduced = without(bench, rivals[0], rest)
        if weigh(bench, search.pulses, search.held_out, [reduced, rivals[0]])[0].placed == reduced.placed:
            beside = step(search, without(bench, reduced, rest[:-1]), refits=SWAPS).rivals
            return search.ranked([reduced, *(r for r in beside if r.name != reduced.name)])
        found = step(search, reduced, refits=SWAPS).rivals
        known = {r.name for r in rivals}
        rivals = search.ranked(rivals + [r for r in found if r.name not in known])
    return rivals


def _alike(search: Search, naive: Explanation, best: Explanation) -> tuple[Explanation, Pulses]:
    """`naive`, tamed where `best` was, as what is compared is fitted alike, and the pulses in its training windows.
    Numerics stay those of `best`."""
    before = search.bench.offsets
    found = tamed(search.bench, replace(naive, **best.weighed))
    seen = search.pulses if found.fitted is naive.fitted else pulses(search.bench.training, found.fitted)
    search.bench.restore(before)
    return found, seen


def _answer(search: Search, naive: Explanation, steps: list[Step], best: Explanation, others) -> Naming:
    bench, windows, parts = search.bench, (search.pulses, search.held_out), both(search.bench, best)
    naive, seen = _alike(search, naive, best)
    pushing = disturbance(best.fitted, search.pulses)
    shades = [colour(found, pushing) for found in windows]
    spread, wide = widened(parts, shades)
    fitted, found = pooled(parts, *windows)
    stranger = nameless(bench, best, coloured(fitted, found, pushing), found, search.candidates)
    gained = max(explained(shades, both(bench, naive), parts), 0.0)
    left = stranger.gain / max(stranger.gain + gained, 1e-9)
    total = spread * pushing.noise**2
    misfit = sum(p.point.squares.sum() for p in parts) / sum(p.point.samples.sum() for p in parts)
    return Naming(naive, steps, best, members(best, others), left, stranger, total, misfit, wide, seen)
