"""From a track to an explanation: what is missing in its model, as far as was asked."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fimpact.deciding import SHARE
from fimpact.effects.base import Effect, Scales
from fimpact.selection.forward import Search
from fimpact.selection.one_round import Round, Trial
from fimpact.selection.pruning import simplified, without_doubtful_parts
from fimpact.selection.regression import Regression
from fimpact.selection.rivals import unsettled
from fimpact.selection.search_scope import Limits
from fimpact.selection.servo_drives import align, drive, restored
from fimpact.selection.soft_gears import softened
from fimpact.selection.substitutes import Alternative
from fimpact.selection.unnamed_rest import Leftover, leftover
from fimpact.smoothing.dynamics.track import Track
from fimpact.smoothing.servo_lag import Way
from fimpact.smoothing.smoother import Smoothed
from fimpact.smoothing.states import States


@dataclass(frozen=True)
class Explanation:
    """What was found: the naive fit, the final one, which of its effects are small refinements, rounds, alternatives,
    the chance of the strongest hint where nothing was, and what is left without a name. asked: makes the columns of all
    that was asked beside the final fit. unfitted: where nothing is named, what qualified and no fit settled with."""

    naive: Smoothed
    final: Smoothed
    slight: frozenset[str]
    rounds: tuple[Round, ...]
    alternatives: tuple[Alternative, ...]
    p: float
    scales: Scales
    left: Leftover
    unasked: tuple[str, ...] = ()
    asked: Callable[[], Regression] | None = None
    unfitted: tuple[Trial, ...] = ()


def explain(
    track: Track, begun: States, noise: np.ndarray, effects: Sequence[Effect], progress: Callable = lambda line: None,
    limits: Limits | None = None, late: Sequence[Way] = (), naive: Smoothed | None = None,
) -> Explanation:  # fmt: skip
    """Find what is missing: classes of physics and single odd effects, and small refinements of both, as far as
    `limits` go.

    Args:
        late: how late all motors may be, as the readings show it before anything else is known. naive: the fit of the
            naive model, where it is known.
    """
    limits = limits or Limits()
    state = Search(track, begun, noise, limits.effects(effects), progress, naive)
    state.limits = limits
    if state.asks():
        align(state, late)
    if state.asks():
        drive(state)
    for _ in range(2):  # what a part in doubt stood in the way of is asked once it has gone
        going = True
        while going:
            while state.asks() and state.round():
                pass
            going = not state.stopped and (restored(state) or softened(state))
        before, state.current = state.current, without_doubtful_parts(state)
        if state.current is before:
            break
    final = state.current = simplified(state)
    others = [*state.alternatives, *unsettled(state)]
    return Explanation(
        state.naive, final, frozenset(state.slight), tuple(state.rounds), tuple(others), state.hint,
        state.scales, leftover(final, state.whole(final, SHARE)), limits.unasked(state.stopped), state.beside,
        () if final.placed else tuple(trial for trial, _ in state.unfitted),
    )  # fmt: skip
