"""Commands over a sample: constant, or as laws between command and motor change them."""

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.simulation.nonsmooth import stop_within_a_step

DELAY = "command_delay"  # the effect that moves a command's jump into a sample
INSTANT = 1e-9  # of a sample: what is nearer is one moment


@dataclass(frozen=True)
class Commands:
    """Commands that reach the plant, each held for its part of a sample, (N, parts, nu).

    jumps: moments at which a command that came late jumps, in parts of a sample, and the part that begins there. A
    servo that pushes as hard as it may is not moved by the mean of two targets as it is by the one and then the other:
    a step ends at each jump. instant: at the start of each sample, (N, nu), which is what a sensor of forces shows
    there; None where it is what the first part holds.
    """

    values: np.ndarray
    jumps: tuple[tuple[float, int], ...] = ()
    instant: np.ndarray | None = None
    _known: dict[tuple[int, int], list[tuple[float, np.ndarray]]] = field(default_factory=dict, repr=False)

    def __getitem__(self, rows) -> "Commands":
        return Commands(self.values[rows], self.jumps, None if self.instant is None else self.instant[rows])

    @property
    def mean(self) -> np.ndarray:
        """Of each sample, (N, nu)."""
        return self.values.mean(1)

    def same(self, other: "Commands") -> bool:
        """Whether the plant is told the same."""
        return self.jumps == other.jumps and np.array_equal(self.values, other.values)

    def legs(self, model: mujoco.MjModel, period: float, least: int) -> Iterator[tuple[mujoco.MjModel, np.ndarray]]:
        """Legs between jumps: the model at a step that fits into each, and the commands of its steps, (N, steps, nu),
        or (N, nu) where they are the same in all.

        Args:
            least: steps of the coarsest simulation that this one is compared with, for a whole sample.
        """
        substeps, parts = round(period / model.opt.timestep), self.values.shape[1]
        if not self.jumps:
            yield model, self.values[:, 0] if parts == 1 else self._even(substeps)
            return
        if (substeps, least) not in self._known:
            self._known[substeps, least] = list(self._between_jumps(substeps, least))
        for part, values in self._known[substeps, least]:
            yield _at_step(model, part * period), values

    def _between_jumps(self, substeps: int, least: int) -> Iterator[tuple[float, np.ndarray]]:
        """The step of each leg, in parts of a sample, and the commands of its steps, (N, steps, nu)."""
        for (begin, first), (end, last) in pairwise(((0.0, 0), *self.jumps, (1.0, self.values.shape[1]))):
            steps = max(int(np.ceil((end - begin) * least - INSTANT)), 1) * (substeps // least)
            yield (end - begin) / steps, self._means(np.linspace(first, last, steps + 1))

    def _even(self, steps: int) -> np.ndarray:
        """Of equal steps, (N, steps, nu)."""
        parts = self.values.shape[1]
        if parts > steps:  # as coarse as the mean of them
            return np.stack([part.mean(1) for part in np.array_split(self.values, steps, 1)], 1)
        return np.repeat(self.values, steps // parts, 1)

    def _means(self, edges: np.ndarray) -> np.ndarray:
        """Between `edges`, numbers of parts, (N, steps, nu)."""
        whole = np.minimum(edges.astype(int), self.values.shape[1] - 1)
        sums = self._total[:, whole] + (edges - whole)[:, None] * self.values[:, whole]
        return np.diff(sums, axis=1) / np.diff(edges)[:, None]

    @cached_property
    def _total(self) -> np.ndarray:
        """Of all parts before each, (N, parts + 1, nu)."""
        return np.concatenate([np.zeros_like(self.values[:, :1]), np.cumsum(self.values, 1)], 1)


def sharp(laws: Sequence[Placed], period: float, parts: int) -> tuple[list[Placed], tuple[tuple[float, int], ...]]:
    """The laws with delays that end where one of `parts` of a sample does, and the jumps, as in `Commands`."""
    moments = {law.name: law.values["delay"] / period for law in laws if law.effect.name == DELAY}
    within = sorted({part for part in (moment % 1.0 for moment in moments.values()) if INSTANT < part < 1 - INSTANT})
    if not within or len(within) >= parts:
        return list(laws), ()
    # Each at a part of its own, in order, with at least one before and after all of them.
    count = np.arange(len(within))
    begins = np.maximum.accumulate(np.maximum(np.round(np.array(within) * parts).astype(int) - count, 1))
    begins = np.minimum(begins, parts - len(within)) + count
    jumps = tuple((part, int(begin)) for part, begin in zip(within, begins, strict=True))

    def moved(law: Placed) -> Placed:
        part = moments[law.name] % 1.0
        begin = dict(jumps).get(part)
        at = round(moments[law.name]) if begin is None else np.floor(moments[law.name]) + begin / parts
        return replace(law, values={"delay": float(at * period)})

    return [moved(law) if law.name in moments else law for law in laws], jumps


def _at_step(model: mujoco.MjModel, step: float) -> mujoco.MjModel:
    own = copy.copy(model)
    own.opt.timestep = step
    stop_within_a_step(own)
    return own
