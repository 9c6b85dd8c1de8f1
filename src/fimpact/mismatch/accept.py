"""Accept: which of a round's rivals is worth having and keeps its word.

Rivals are ranked by what one linear step promises under a model of what disturbs the robot. Before one is believed it
is fitted there, and must really predict held-out windows no worse.
"""

import numpy as np

from fimpact.mismatch.colour import colour
from fimpact.mismatch.disturbance import disturbance
from fimpact.mismatch.explain import Explanation, numerics, sharpened
from fimpact.mismatch.fit import lost
from fimpact.mismatch.generalised import tempered
from fimpact.mismatch.judge import Bench
from fimpact.mismatch.step import Search, Step
from fimpact.mismatch.tame import WILD, tamed
from fimpact.mismatch.weigh import predicted, weigh

TRACE = 0.03  # share of what there was to explain that is not worth a further effect
SURE, CHANCE = 5e-4, 4.0  # family-wise p that held-out runs need not confirm; squares that are chance, two deviations
LOSSES = ((SURE, 9.0), (5e-3, 1.0))  # up to which p a first effect may lose how many squares of held-out runs
TRIES, SLACK = 3, 0.01  # rivals that are sharpened in a round; share of the held-out squares that is chance
CALM = 2.0  # dispersion up to which disturbances are nearly what they are taken for, and squares in their colour decide


def hopeful(best: Explanation, rivals: list[Explanation]) -> list[Explanation]:
    """The likeliest, and those others that look like keeping their word: once it has broken its own, only they are
    worth the time. Where nothing is near the noise, almost all that is left passes for disturbances and one step may
    promise anything: there only what really predicts better is."""
    serves = improved if rivals and rivals[0].loudness > WILD else kept
    return [*rivals[:1], *(r for r in rivals[1:] if serves(best, r))]


def worthwhile(search: Search, naive: Explanation, current: Explanation, last: Step) -> bool:
    """Whether the best rival predicts held-out windows better, and a further one by more than a trace of what there was
    to explain, unless it relieves parameters of values that nobody would believe. What training shows beyond doubt, a
    few held-out runs may fail to show by chance, and of a further one no more than a hint; what they do show counts."""
    pushing = disturbance(last.rivals[0].fitted, search.pulses)
    shades = colour(search.pulses, pushing), colour(search.held_out, pushing)
    (before, now, then), (_, bent, straight) = predicted(search.bench, (naive, current, last.rivals[0]), shades)
    sure = last.least <= SURE
    # One linear step promises little of an effect that is large, or met in contact; what was simulated is there.
    if sure and improved(current, last.rivals[0]):
        return True
    if current.placed:
        return bool(now - then + bent - straight > (0.0 if sure else max(TRACE * (before - now), 0.0)))
    return bool(then - now < next((loss for p, loss in LOSSES if last.least <= p), 0.0))


def beats(search: Search, found: Explanation, best: Explanation) -> bool:
    """Whether an explanation that adds nothing to `best`, but came to stand in its place, is the likelier."""
    if len(found.placed) > len(best.placed):
        return True
    return weigh(search.bench, search.pulses, search.held_out, [found, best])[0].name == found.name


def accepted(search: Search, best: Explanation, promised: Explanation) -> Explanation | None:
    """`promised` at its generalised optimum (where collisions leave loud windows, `tamed`), or as it was fitted where
    only that predicts held-out windows, for disturbances need not be what they are taken for, or, where nothing is near
    the noise, where that predicts them better; None, and numerics as they were, if neither does."""
    before = search.bench.offsets
    plain = _own(search.bench, promised)
    own = search.bench.offsets
    found = tamed(search.bench, sharpened(search.bench, search.pulses, plain))
    ordinary = not idle(plain) and kept(best, plain)
    rather = ordinary and plain.loudness > WILD and improved(found, plain)
    if not rather and not idle(found) and (kept(best, found) or _kept_among(search, best, found)):
        return found
    search.bench.restore(own if ordinary else before)
    return plain if ordinary else None


def _own(bench: Bench, promised: Explanation) -> Explanation:
    """`promised` with numerics of its own, to which those of `bench` are set: as they are known, but where nothing is
    near the noise, among disturbances or at all, and there may be several, sought from here."""
    if promised.offsets is None or promised.loudness > WILD or lost(promised.fitted.point):
        return numerics(bench, promised)
    bench.restore(promised.offsets)
    return promised


def _kept_among(search: Search, before: Explanation, after: Explanation) -> bool:
    """Whether held-out windows are predicted no worse among disturbances, where those are what they are taken for, and
    by parameters as uncertain as training leaves them: to follow an effect that they hide, parameters may have to leave
    values that had imitated the disturbances, and what they do in a faster motion is less certain than in these."""
    if after.loudness > CALM:
        return False
    pushing = disturbance(after.fitted, search.pulses)
    shades = colour(search.pulses, pushing), colour(search.held_out, pushing)
    was, now = predicted(search.bench, (before, after), shades)[0]
    return bool(now <= was + CHANCE)


def kept(before: Explanation, after: Explanation) -> bool:
    """Whether held-out windows really are predicted no worse, but for chance: what one linear step promised of an
    effect that is large, or of one that the windows hardly show, need not come true. Neither a loud window nor the
    quiet ones alone decide it."""
    points = before.judged.point, after.judged.point
    tame = [tempered(point.squares, point.samples) for point in points]
    return _no_worse(*(point.squares for point in points)) and _no_worse(*tame)


def improved(before: Explanation, after: Explanation) -> bool:
    """Whether held-out windows really are predicted better by more than chance, loud windows or not."""
    points = before.judged.point, after.judged.point
    tame = [tempered(point.squares, point.samples).sum() for point in points]
    return bool(min(points[0].squares.sum() - points[1].squares.sum(), tame[0] - tame[1]) > CHANCE)


def _no_worse(was: np.ndarray, now: np.ndarray) -> bool:
    return bool(now.sum() <= was.sum() + max(CHANCE, SLACK * was.sum()))


def idle(explanation: Explanation) -> bool:
    """Whether an effect was added that, once fitted, does nothing: one step promised what its bounds do not allow."""
    return any(
        all(p.values[c.name] == p.effect.neutral[c.name] for c in p.effect.coefficients if not c.shape)
        for p in explanation.placed
    )
