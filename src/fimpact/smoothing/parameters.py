"""The numbers that are estimated together with a trajectory: the case's unknowns, and the coefficients of effects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import TRUST
from fimpact.effects.base import Placed
from fimpact.recordings import FIELDS, Recording
from fimpact.simulation.simulator import Simulator

TINY = 1e-4  # of what such parts have: a size that is none
NUDGE = 1e-4  # relative step of a difference quotient


@dataclass(frozen=True)
class Parameter:
    """One number: value, prior mean and sd (inf: none), bounds, and whether it moves in logarithms.

    of: ``field@site`` of an unknown or ``effect@site``; place: index of its effect, -1 for an unknown.
    """

    name: str
    of: str
    unit: str
    place: int
    value: float
    mean: float
    sd: float
    low: float
    high: float
    log: bool
    size: float

    @property
    def slope(self) -> float:
        """Change of the value with its coordinate."""
        return self.value if self.log else 1.0

    @property
    def spread(self) -> float:
        """Prior sd of the coordinate: of the logarithm where both value and mean are more than nothing."""
        if not np.isfinite(self.sd) or not self.slope:
            return np.inf
        return self.sd / abs(self.mean if self._in_logarithms else self.slope)

    @property
    def away(self) -> float:
        """From the coordinate to its prior mean, in prior sd."""
        if not np.isfinite(self.spread):
            return 0.0
        return float(
            np.log(self.mean / self.value) / self.spread if self._in_logarithms else (self.mean - self.value) / self.sd
        )

    @property
    def _in_logarithms(self) -> bool:
        return self.log and self.mean > 0 and self.value > 0

    @property
    def nudge(self) -> float:
        """A step of the coordinate for a difference quotient."""
        return NUDGE if self.log else NUDGE * self.size

    @property
    def at_bound(self) -> bool:
        """Whether it lies where it may go no further."""
        return any(np.isfinite(b) and np.isclose(self.value, b, rtol=1e-9, atol=0) for b in (self.low, self.high) if b)

    def moved(self, step: float) -> "Parameter":
        """Itself a `step` of its coordinate further, at most a factor of two in logarithms, and within its bounds."""
        value = self.value * np.exp(np.clip(step, -np.log(TRUST), np.log(TRUST))) if self.log else self.value + step
        return replace(self, value=float(np.clip(value, self.low, self.high)))


def parameters(
    simulator: Simulator, theta: np.ndarray, placed: Sequence[Placed], priors: Sequence[dict[str, float]]
) -> list[Parameter]:
    """All numbers of a hypothesis; priors: sd of the amplitudes of each effect."""
    found = [_unknown(u, float(v), float(own)) for u, v, own in _rows(simulator.recording, theta, simulator.theta)]
    for place, (law, prior) in enumerate(zip(placed, priors, strict=True)):
        found += [_coefficient(law, c, place, prior) for c in law.effect.coefficients if c.name not in law.held]
    return found


def theta_of(numbers: Sequence[Parameter]) -> np.ndarray:
    """Values of the unknowns, (p,)."""
    return np.array([n.value for n in numbers if n.place < 0])


def placed_of(numbers: Sequence[Parameter], placed: Sequence[Placed]) -> tuple[Placed, ...]:
    """The effects with their values."""
    values = [dict(law.values) for law in placed]
    for n in numbers:
        if n.place >= 0:
            values[n.place][n.name] = n.value
    return tuple(replace(law, values=own) for law, own in zip(placed, values, strict=True))


def is_shape(placed: Placed, name: str) -> bool:
    """Whether a coefficient of an effect is a shape and no amplitude."""
    return next(c.shape for c in placed.effect.coefficients if c.name == name)


def _rows(recording: Recording, theta, own):
    return zip(recording.unknowns, theta, own, strict=True)


def _unknown(unknown, value: float, own: float) -> Parameter:
    unit, positive, _ = FIELDS[unknown.field]
    log = positive and own > 0
    size = abs(own) or 1.0
    low = np.finfo(float).tiny if log else 0.0 if positive else -np.inf
    return Parameter(unknown.field, unknown.name, unit, -1, value, own, unknown.sd * size, low, np.inf, log, size)


def _coefficient(law: Placed, c, place: int, prior: dict[str, float]) -> Parameter:
    low, high = law.ranges.get(c.name, (c.low, c.high))
    value = float(np.clip(law.values[c.name], low, high))
    neutral = law.effect.neutral[c.name]
    log = neutral == 0 and low == 0 and value > 0 and not c.shape
    log |= c.shape and low > 0
    if log and not c.shape and np.isfinite(prior.get(c.name, np.inf)):
        low = min(TINY * prior[c.name], value)  # in logarithms nothing is infinitely far away
    size = max(abs(value), 0.1 * prior.get(c.name, 0.0)) or law.sizes.get(c.name) or 1e-3
    mean, sd = (value, np.inf) if c.shape else (neutral, prior.get(c.name, np.inf))
    if c.even and np.isfinite(high - low):
        mean, sd = (low + high) / 2, (high - low) / np.sqrt(12)
    if not np.isfinite(neutral):  # nothing is infinitely much: of its order, as such parts have it
        log, mean, sd = value > 0, prior.get(c.name, value), prior.get(c.name, np.inf)
    return Parameter(c.name, law.name, c.unit, place, value, mean, sd, low, high, log, size)
