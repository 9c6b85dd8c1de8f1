"""Weigh: how much each explanation is to be believed among its rivals, and which cannot be told from the best."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.mismatch.colour import CLOCK, Colour, colour
from fimpact.mismatch.disturbance import FEW, disturbance
from fimpact.mismatch.explain import Explanation, explain
from fimpact.mismatch.fit import Fit, inverse
from fimpact.mismatch.generalised import Generalised, generalised
from fimpact.mismatch.judge import Bench, exposed
from fimpact.mismatch.price import price
from fimpact.mismatch.pulses import Felt
from fimpact.mismatch.simulate import Hypothesis

STRAY = 9.0  # squares of a window by which another rival's sensitivities must do better to be taken
# Weight, relative to the best, above which an explanation cannot be told from it; and one that says the same with more.
MEMBERS, WORDY = 1 / 200, 1 / 40
EVEN = 0.8  # weight, relative to the likeliest, above which the earlier in the catalogue is named first


def weigh(bench: Bench, found: Felt, held_out: Felt, rivals: list[Explanation]) -> list[Explanation]:
    """Rivals in falling order of weight, exp(-deviance / 2) with overdispersion, all under the disturbance that the
    likeliest of them leaves: generalised squares of all windows together, the price of effects, and what was known
    before. Held-out windows are predicted as uncertain as the parameters are, by refitting
    both sets together."""
    if not rivals:
        return []
    rivals = [replace(rival, exposed=both(bench, rival)[1]) for rival in rivals]
    pushing = disturbance(min(rivals, key=lambda r: explain(*r.parts).deviance).fitted, found)
    shades = colour(found, pushing), colour(held_out, pushing)
    optima = [generalised(parts, shades) for parts in lent([both(bench, r) for r in rivals], shades)]
    bent = np.array([o.bent for o in optima])
    squares = np.array([o.total for o in optima]) - bent
    least = int(np.argmin(squares + bent + _paid(rivals, optima, 1.0).sum(1)))
    spread = dispersion(rivals[least].parts, optima[least].deviances, pushing.noise)
    # Data that say less know less of shapes.
    paid = _paid(rivals, optima, spread)
    prices = paid.sum(1) + bent
    # What data say is divided by their dispersion, prices and priors are not (quasi-likelihood, Burnham & Anderson).
    deviance = squares + prices * spread
    raw = np.exp(-(deviance - deviance.min()) / 2 / spread)
    weighted = [
        replace(r, weight=float(w), deviance=float(d), shaped=float(s), dispersion=spread, noise=pushing.noise)
        for r, w, d, s in zip(rivals, raw / raw.sum(), deviance, paid[:, 1], strict=True)
    ]
    return sorted(weighted, key=lambda r: r.deviance)


def _paid(rivals: list[Explanation], optima: list[Generalised], spread: float) -> np.ndarray:
    """Price of amplitudes and of shapes, (r, 2), where variances are `spread` times those of the optima."""
    return np.array([price(r.parts, spread * o.covariance) for r, o in zip(rivals, optima, strict=True)])


def lent(rivals: Sequence[tuple[Fit, ...]], shades: Sequence[Colour]) -> list[list[Fit]]:
    """The fits of each rival, with another's sensitivities to initial states in windows where they explain far more.

    A secant across the instant of an impact shows a jump and no slope; which rival meets one is chance, and must not
    decide between them.
    """
    sets = [_lent(fits, shade) for fits, shade in zip(zip(*rivals, strict=True), shades, strict=True)]
    return [list(parts) for parts in zip(*sets, strict=True)]


def _lent(fits: Sequence[Fit], shade: Colour) -> list[Fit]:
    states = np.stack([fit.linear.basis @ fit.linear.triangle for fit in fits])
    bases, out = [np.linalg.qr(shade.white(own))[0] for own in states], []
    for i, fit in enumerate(fits):
        left = shade.white(fit.point.residual[..., None])
        taken = np.array([((basis.transpose(0, 2, 1) @ left) ** 2).sum((1, 2)) for basis in bases])
        best = np.where(taken.max(0) > taken[i] + STRAY, taken.argmax(0), i)
        basis, triangle = np.linalg.qr(states[best, np.arange(len(best))])
        linear = replace(fit.linear, basis=basis, triangle=triangle)
        out.append(replace(fit, linear=replace(linear, projected=linear.off(linear.raw))))
    return out


def both(bench: Bench, explanation: Explanation) -> tuple[Fit, Fit]:
    """Training and held-out windows under `explanation`, ready to be fitted together."""
    shown = explanation.exposed or exposed(bench.held_out, explanation.judged, explanation.fitted)
    return explanation.fitted, shown


def dispersion(parts: Sequence[Fit], sums: list[np.ndarray], noise: float) -> float:
    """What differences of deviance, and variances, are scaled by: 1 for noise, more where a residual remembers itself.

    A window's sum of squares is taken as a scaled chi-square, its scale by moments: variance / (2 mean); where windows
    are quieter than the sensors, as those in which a coarse encoder stands still, by those moments of louder ones.

    Args:
        sums: squares of each training and each held-out window, (w,) each. noise: of what is white in them, in units of
            that of the sensors.
    """
    found = []
    for part, own in zip(parts, sums, strict=True):
        samples = part.point.samples
        found.append(own.sum() / samples.sum())
        if len(own) >= FEW:
            scatter = _scatter(own * samples.mean() / samples, samples.mean() / noise**2)
            found.append(scatter / (2 * own.mean()))
    return float(max(1.0, *found))


def _scatter(squares: np.ndarray, quiet: float) -> float:
    """Variance of `squares`, (w,), or twice the part of it that is above their mean and what is `quiet`, if less."""
    louder = np.maximum(squares - max(squares.mean(), quiet), 0.0)
    return min(np.var(squares, ddof=1), 2 * (louder**2).sum() / (len(squares) - 1))


def widened(parts: Sequence[Fit], shades: Sequence[Colour]) -> tuple[float, np.ndarray]:
    """What training and held-out windows, one explanation's, are dispersed by among disturbances, and the covariance of
    its coordinates, (k, k), those counted: of the generalised estimate, or, where the explanation was left as ordinary
    squares have it, of that."""
    spread = dispersion(parts, generalised(parts, shades).deviances, shades[0].noise)
    optimum = generalised(parts[:1], shades[:1])
    known = spread * optimum.covariance
    if np.all(np.abs(optimum.step) <= np.sqrt(np.diag(known))):
        return spread, known
    # What is dispersed beyond the disturbances counts as it does for the generalised estimate.
    return spread, known - optimum.covariance + _ordinary(parts[0], shades[0])


def _ordinary(fitted: Fit, shade: Colour) -> np.ndarray:
    """Covariance, (k, k), of what ordinary squares find among disturbances, which they let drag parameters as far as
    those imitate them (sandwich; White, Econometrica 1980)."""
    seen, prior = fitted.linear.projected, np.diag(fitted.coordinates.sd**-2.0)
    along = shade.directions.transpose(0, 2, 1) @ seen
    plain = np.einsum("wma,wmb->ab", seen, seen)
    loud = np.einsum("wca,wc,wcb->ab", along, shade.louder**2 - 1, along)
    late = CLOCK * np.einsum("wma,wmr->ar", seen, shade.clocks)
    bread = inverse(plain + prior, fitted.scale)
    return bread @ (shade.noise**2 * (plain + loud) + late @ late.T + prior) @ bread


def explained(shades: Sequence[Colour], naive: Sequence[Fit], current: Sequence[Fit]) -> float:
    """Generalised squares by which `current` fits sets of windows, of a colour each, better than `naive`."""
    before, after = (generalised(fits, shades).total for fits in lent([naive, current], shades))
    return before - after


def predicted(bench: Bench, explanations: Sequence[Explanation], shades: tuple[Colour, Colour]) -> np.ndarray:
    """Squares of the held-out windows as each explanation predicts them from training: what they add to those of
    training alone; and how far it bends what was known before, (2, e)."""
    pairs = lent([both(bench, e) for e in explanations], shades)
    optima = [(generalised(fits, shades), generalised(fits[:1], shades[:1])) for fits in pairs]
    return np.array([(all_.total - alone.total, all_.bent) for all_, alone in optima]).T


def members(
    best: Explanation, others: list[Explanation], least: float = MEMBERS, wordy: float = WORDY
) -> list[Explanation]:
    """`best` and those of the `others` that the recordings cannot tell from it, of at least `least` of its weight, or
    `wordy` where they say the same with more coefficients."""
    needed = {False: least, True: wordy}
    return [best, *(r for r in others if r.weight >= needed[generalises(r, best)] * best.weight)] if best.placed else []


def leading(ranked: list[Explanation], catalogue: Sequence[str]) -> Explanation:
    """Of those `ranked` by weight that the data find about equal, the one whose effects come first in the
    `catalogue`."""
    even = [r for r in ranked if r.weight >= EVEN * ranked[0].weight]
    return min(even, key=lambda r: sorted(catalogue.index(p.effect.name) for p in r.placed))


def led_by(first: Explanation, ranked: list[Explanation]) -> list[Explanation]:
    """`first`, and the others of `ranked` in their order."""
    return [first, *(r for r in ranked if r is not first)]


def generalises(rival: Explanation | Hypothesis, best: Explanation | Hypothesis) -> bool:
    """Whether `rival` says what `best` says, with more coefficients: chance alone lets it fit somewhat better."""
    special = {(p.effect.name, p.site) for p in best.placed}
    covered = {(name, p.site) for p in rival.placed for name in (p.effect.name, *p.effect.contains)}
    return special <= covered
