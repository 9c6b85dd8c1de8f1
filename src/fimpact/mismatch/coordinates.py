"""Coordinates: the numbers that are fitted, their bounds, scales and what is known of them before."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from fimpact.effects.base import Placed
from fimpact.mismatch.simulate import Hypothesis, Simulator
from fimpact.recordings import FIELDS

SECANT = 1e-5  # of a coordinate's scale: a thousandth of a thousandth of what it does, as little as may be concealed
FRAME = 1e-5  # m, rad: well above the 1e-6 up to which MuJoCo takes a frame for that of its body


@dataclass(frozen=True)
class Coordinates:
    """The numbers that are fitted: the recording's unknowns, then the named values of each placed effect.

    low, high, scale, mean, sd, step: (k,) each; mean and sd are those of the prior, sd = inf where there is none; step:
    length of a secant.
    """

    unknowns: int
    values: tuple[tuple[int, str], ...]
    low: np.ndarray
    high: np.ndarray
    scale: np.ndarray
    mean: np.ndarray
    sd: np.ndarray
    step: np.ndarray

    def read(self, hypothesis: Hypothesis) -> np.ndarray:
        """The coordinates of `hypothesis`, (k,)."""
        extra = [hypothesis.placed[i].values[name] for i, name in self.values]
        return np.append(hypothesis.theta[: self.unknowns], extra)

    def write(self, hypothesis: Hypothesis, z: np.ndarray) -> Hypothesis:
        """`hypothesis` moved to the coordinates `z`, (k,), held within their bounds."""
        z = np.clip(z, self.low, self.high)
        placed = list(hypothesis.placed)
        for (i, name), value in zip(self.values, z[self.unknowns :], strict=True):
            placed[i] = replace(placed[i], values={**placed[i].values, name: float(value)})
        return Hypothesis(np.append(z[: self.unknowns], hypothesis.theta[self.unknowns :]), tuple(placed))

    def without(self, held: Collection[tuple[int, str]]) -> "Coordinates":
        """These coordinates less the values `held`, each (index of the placed effect, name)."""
        kept = np.array([True] * self.unknowns + [value not in held for value in self.values], bool)
        values = tuple(value for value in self.values if value not in held)
        rest = (getattr(self, name)[kept] for name in ("low", "high", "scale", "mean", "sd", "step"))
        return Coordinates(self.unknowns, values, *rest)


NOTHING = Coordinates(0, (), *(np.zeros(0),) * 6)
"""No coordinates at all: only initial states are fitted."""


def coordinates(simulator: Simulator, placed: tuple[Placed, ...] = (), scales: tuple[dict, ...] = ()) -> Coordinates:
    """The recording's unknowns and the coefficients of `placed`; `scales`: a typical size of each by name."""
    nominal = simulator.theta
    unknowns = simulator.recording.unknowns
    unit = np.where(nominal != 0, np.abs(nominal), 1.0)
    sd = np.array([u.sd for u in unknowns]) * unit
    positive = np.array([FIELDS[u.field][1] for u in unknowns], bool)
    low = np.where(positive, 1e-3 * unit * (nominal != 0), -np.inf)
    names, lows, highs, sizes, sds, units = [], [], [], [], [], [FIELDS[u.field][0] for u in unknowns]
    for i, (hypothesis, scale) in enumerate(zip(placed, scales, strict=True)):
        for coefficient in (c for c in hypothesis.effect.coefficients if c.name not in hypothesis.held):
            names.append((i, coefficient.name))
            least, most = hypothesis.ranges.get(coefficient.name, (coefficient.low, coefficient.high))
            lows.append(least)
            highs.append(most)
            units.append(coefficient.unit)
            sds.append(coefficient.sd)
            sizes.append(max(abs(scale[coefficient.name]), 1e-9))
    count, finite = len(names), np.where(np.isfinite(sd), np.minimum(sd, unit), unit)
    scale = np.append(finite, sizes)
    return Coordinates(
        len(nominal),
        tuple(names),
        np.append(low, lows),
        np.append(np.full(len(nominal), np.inf), highs),
        scale,
        np.append(nominal, np.zeros(count)),
        np.append(np.where(sd > 0, sd, np.inf), sds),
        np.maximum(SECANT * scale, FRAME * np.isin(units, ("m", "rad"))),
    )
