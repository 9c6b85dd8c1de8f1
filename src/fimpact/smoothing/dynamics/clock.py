"""The clock of a run against that of its commands: no stamps are truer than some hundredth of a sample.

How late the readings of a run are is one number of it, of which nothing is asked: a state of the filter that stays as
it is. Where nothing is commanded there is no such number: any motion may begin at any time.
"""

import numpy as np

from fimpact.deciding import STAMPED
from fimpact.smoothing.dynamics.track import Step, Track


def rates(track: Track, base: Step) -> np.ndarray | None:
    """Compute what a clock that is late by as much as stamps may be does to the readings.

    Args:
        base: the sample ahead of each state.

    Returns:
        (N, ny), in the units of the readings, or None where nothing is commanded.
    """
    if not track.model.nu:
        return None
    if base.within is not None and base.within.shape[1] > 1:
        return (base.within[:, 1] - base.within[:, 0]) * (base.within.shape[1] * STAMPED)
    ahead = np.arange(track.count) + ~track.last
    change = base.readings[ahead] - base.readings
    ends = np.flatnonzero(track.last & (track.lengths[track.run_of] > 1))
    change[ends] = change[ends - 1]
    return change * STAMPED


def beside(matrix: np.ndarray, rows: int, columns: int, at: int) -> np.ndarray:
    """Insert `columns` of nothing `at` the given one, and put as many rows of nothing below.

    Args:
        matrix: (N, r, c).

    Returns:
        (N, r + rows, c + columns).
    """
    count, r, c = matrix.shape
    out = np.zeros((count, r + rows, c + columns))
    out[:, :r, :at], out[:, :r, at + columns :] = matrix[:, :, :at], matrix[:, :, at:]
    return out
