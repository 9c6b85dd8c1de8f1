"""Diagnoses of small recordings without a search: what it would have found is given, and all else is as it is."""

from functools import cache
from unittest.mock import patch

from recorded import rod

from fimpact.diagnosis import pipeline
from fimpact.diagnosis.pipeline import Diagnosis, diagnose
from fimpact.effects import EFFECTS
from fimpact.recordings import Recording
from fimpact.selection.explanation import Explanation
from fimpact.selection.forced import fit_forced
from fimpact.selection.substitutes import Alternative
from fimpact.selection.unnamed_rest import Leftover
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.prepare import Prepared
from fimpact.smoothing.smoother import Smoothed, smooth
from fimpact.smoothing.time_step import settled


def diagnosis_of(
    recording: Recording, answer: tuple[str, ...] = (), rivals: tuple[str, ...] = (), brief: bool = False
) -> Diagnosis:
    """A diagnosis as it would be had the search answered the effects `answer`, ``effect@site`` each, and kept each of
    the effects `rivals` as an alternative with weight .4."""

    def explain(track, begun, noise, effects, progress, limits, late, known):
        prepared = Prepared(track, begun, noise)
        naive = known or smooth(track, begun, noise)
        final = _forced(prepared, naive, answer) if answer else naive
        others = [_forced(prepared, naive, (name,)) for name in rivals]
        kept = tuple(Alternative(fit.placed, fit.theta, 0.4) for fit in others)
        left = Leftover(None, None, 0.0, ())
        return Explanation(naive, final, frozenset(), (), kept, 0.01, motion_scales(naive), left)

    with patch.object(pipeline, "explain", explain):
        return diagnose(recording, brief=brief)


def _forced(prepared: Prepared, naive: Smoothed, names: tuple[str, ...]) -> Smoothed:
    places = [(EFFECTS[effect], site) for effect, _, site in (name.partition("@") for name in names)]
    return settled(fit_forced(prepared, naive, places), prepared.begun, prepared.noise)


@cache
def rubbing() -> Diagnosis:
    """Of a rod with dry friction, found."""
    return diagnosis_of(rod(0.03, free=True), ("coulomb@pivot",))


@cache
def undecided() -> Diagnosis:
    """Of the same rod, where viscous friction was not told from dry friction."""
    return diagnosis_of(rod(0.03, free=True), ("coulomb@pivot",), ("viscous@pivot",))


@cache
def nothing() -> Diagnosis:
    """Of a rod that lacks nothing."""
    return diagnosis_of(rod(free=True))
