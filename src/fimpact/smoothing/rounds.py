"""What a fit of the smoother has come to after a round, and the step to the next."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import REFINES, TRUST
from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.linear import Linear, linearise
from fimpact.smoothing.dynamics.response import heavier
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.noise_levels import Levels, in_modes, resting
from fimpact.smoothing.parameters import Parameter, placed_of, theta_of
from fimpact.smoothing.states import States
from fimpact.smoothing.step import Solved


@dataclass(frozen=True)
class Fitted:
    """Trajectory, (N,) states, missing force (N, nv), sd of the speeds (N, nv), noise levels once there are any, and
    numbers."""

    states: States
    tau: np.ndarray
    doubt: np.ndarray
    levels: Levels | None
    numbers: list[Parameter]

    def stepped(self, track: Track, linear: Linear, found: Solved, placed: Sequence[Placed], first: bool) -> "Fitted":
        """What a step leads to.

        Args:
            first: it is the first, and what rests is not yet known.
        """
        assert self.levels is not None
        n, numbers, levels = self.states.size, self.numbers, self.levels
        states = track.space.plus(self.states, found.change[:, :n])
        tau = self.tau + found.change[:, -track.model.nv :]
        doubt = found.doubts(linear, track)
        if numbers:
            numbers = [number.moved(step) for number, step in zip(numbers, found.step, strict=True)]
            grown = heavier(track.model_of(placed_of(numbers, placed), theta_of(numbers)), linear.plant.model)
            tau, levels = tau * grown, replace(levels, force=levels.force * grown, least=levels.least * grown)
        levels = in_modes(track, states, levels)
        # Anew once, then only more: a speed about the bound of its doubt would go to and fro, and levels with it.
        rests, rested = resting(track, states, doubt, linear.plant.rubbing, levels).rests, levels.rests
        return Fitted(states, tau, doubt, replace(levels, rests=rests if first else rests | rested), numbers)


def linear_at(track: Track, own: Fitted, fixed, placed, like, sign, rough: bool, surprise=0.0) -> Linear:
    """The samples linearised at `own`.

    Where a joint sticks, no small force moves it: there what a force does is judged over as much as may be missing.
    """
    spread = np.sqrt((own.levels.forces**2).mean(0)) if own.levels and track.long else None
    placed, theta = placed_of(fixed, placed), theta_of(fixed)
    return linearise(
        track, own.numbers, placed, own.states, own.tau, own.doubt, theta, like, sign, rough, surprise, spread
    )


def runs_away(found: Solved, before: Solved | None, count: int) -> bool:
    """Whether readings, `count` of them, are left behind by a step beside which they were not."""
    near = before is not None and before.chi2 < TRUST * count
    return near and not found.chi2 < TRUST * count


def is_ahead(losses: Sequence[float], bar: float) -> bool:
    """Whether rounds that go to and fro, as where a contact begins in one sample or the next, have long been ahead of
    `bar`, and differ by less than a tenth of that."""
    if not losses or not np.isfinite(bar):
        return False
    return max(losses) - min(losses) < REFINES * (bar - max(losses))
