"""Weigh: how much each explanation is to be believed among its rivals, and which cannot be told from the best."""

from dataclasses import replace

import numpy as np

from fimpact.mismatch.colour import FEW, Colour, colour, disturbance, generalised
from fimpact.mismatch.explain import Explanation, price
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, exposed
from fimpact.mismatch.pulses import Pulses

MEMBERS, WORDY = 1 / 50, 1 / 10  # weight, relative to the best, above which an explanation cannot be told from it


def weigh(bench: Bench, found: Pulses, held_out: Pulses, rivals: list[Explanation]) -> list[Explanation]:
    """Rivals in falling order of weight, exp(-deviance / 2) with overdispersion, all under the disturbance that the
    likeliest of them leaves: generalised squares of all windows together and log(samples) for each coefficient of an
    effect. Held-out windows are predicted as uncertain as the parameters are, by refitting both sets together."""
    if not rivals:
        return []
    pushing = disturbance(min(rivals, key=lambda r: r.deviance).fitted, found)
    shades = colour(found, pushing), colour(held_out, pushing)
    optima = [generalised(both(bench, r), shades) for r in rivals]
    squares, prices = np.array([o.total for o in optima]), np.array([price(r) for r in rivals])
    least = int(np.argmin(squares + prices))
    spread = dispersion(rivals[least], optima[least].deviances)
    # What the data say is divided by their dispersion, a price is not (Burnham & Anderson's quasi-likelihood).
    deviance = squares + prices * spread
    raw = np.exp(-(deviance - deviance.min()) / 2 / spread)
    weighted = [
        replace(r, weight=float(w), deviance=float(d), dispersion=spread)
        for r, w, d in zip(rivals, raw / raw.sum(), deviance, strict=True)
    ]
    return sorted(weighted, key=lambda r: r.deviance)


def both(bench: Bench, explanation: Explanation) -> tuple[Fit, Fit]:
    """Training and held-out windows under `explanation`, ready to be fitted together."""
    return explanation.fitted, exposed(bench.held_out, explanation.judged, explanation.fitted)


def dispersion(best: Explanation, sums: list[np.ndarray]) -> float:
    """What differences of deviance, and variances, are scaled by: 1 for noise, more where a residual remembers itself.

    A window's sum of squares is taken as a scaled chi-square, its scale by moments: variance / (2 mean).

    Args:
        sums: squares of each training and each held-out window, (w,) each.
    """
    found = []
    for part, own in zip(best.parts, sums, strict=True):
        samples = (part.point.residual != 0).sum(1)
        found.append(own.sum() / samples.sum())
        if len(own) >= FEW:
            found.append(np.var(own * samples.mean() / samples, ddof=1) / (2 * own.mean()))
    return float(max(1.0, *found))


def explained(found: Pulses, naive: Fit, current: Fit) -> float:
    """Generalised squares by which `current` fits training windows better than `naive`."""
    shade = [colour(found, disturbance(current, found))]
    return generalised([naive], shade).total - generalised([current], shade).total


def predicted(bench: Bench, explanation: Explanation, shades: tuple[Colour, Colour]) -> float:
    """Squares of the held-out windows as predicted from training: what they add to those of training alone."""
    alone = generalised([explanation.fitted], shades[:1]).total
    return generalised(both(bench, explanation), shades).total - alone


def members(best: Explanation, others: list[Explanation]) -> list[Explanation]:
    """`best` and those of the `others` that the recordings cannot tell from it."""
    least = {False: MEMBERS, True: WORDY}
    return [best, *(r for r in others if r.weight >= least[generalises(r, best)] * best.weight)] if best.placed else []


def generalises(rival: Explanation, best: Explanation) -> bool:
    """Whether `rival` says what `best` says, with more coefficients: chance alone lets it fit somewhat better."""
    special = {(p.effect.name, p.site) for p in best.placed}
    covered = {(name, p.site) for p in rival.placed for name in (p.effect.name, *p.effect.contains)}
    return special <= covered
