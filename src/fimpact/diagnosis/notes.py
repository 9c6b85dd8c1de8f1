"""What a reader must know of the recordings themselves: runs, joints that never move, commands that never change."""

import numpy as np

from fimpact.deciding import BELIEF
from fimpact.effects.base import words
from fimpact.selection.explanation import Explanation
from fimpact.smoothing.prepare import Prepared

SHORT = 20  # samples: less is no run
MOVED = 5.0  # times the noise: a joint that moved by less never moved


def notes_on(prepared: Prepared, found: Explanation) -> list[str]:
    """Sentences, of at most 40 words each."""
    track, notes = prepared.track, []
    if not found.naive.converged:
        notes.append("The naive model's fit did not converge: take the numbers with care.")
    if len(track.runs) == 1:
        notes.append("Only one run was fitted: how much the numbers vary from run to run is not known.")
    far = [words(n.of) for n in found.final.numbers if n.place < 0 and abs(n.away) > BELIEF]
    if far:
        notes.append(
            f"{', '.join(far[:3])}{' and others' if len(far) > 3 else ''}: fitted more than two standard deviations "
            "from what the case says; that is wrong, or something else is missing there."
        )
    still = _still(prepared)
    if still:
        notes.append(f"{', '.join(still[:4])} never moved: nothing can be said of friction or inertia there.")
    if track.model.nu and not np.ptp(track.ctrl[:, 0], axis=0).any():
        notes.append("The commands never change: what depends on them cannot be told.")
    if track.lengths.min() < SHORT:
        notes.append(f"A run has fewer than {SHORT} samples and says little.")
    return notes


def _still(prepared: Prepared) -> list[str]:
    track, out = prepared.track, []
    for column, channel in enumerate(track.recording.channels):
        sensor = track.model.sensor(channel.partition("[")[0])
        known = track.measured[:, column][np.isfinite(track.measured[:, column])]
        if int(sensor.objtype[0]) == 3 and known.size and np.ptp(known) < MOVED * prepared.noise[column]:
            out.append(track.model.joint(int(sensor.objid[0])).name)
    return out
