"""Turned: where joints have turned before a window began, as their sensors show.

Friction that gives before it slips remembers that. A window begins in the middle of a motion, and what a joint would
remember had it always moved as it does there may even have the wrong sign.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from scipy.signal import savgol_filter

from fimpact.mismatch.starts import FITS, JOINTPOS, WIDTHS
from fimpact.mismatch.windows import Windows
from fimpact.recordings import Recording, Run

SURE = 3.0  # standard deviations of noise: the way back from which a joint has turned
MOST = 32  # turns that are remembered
CUBIC = 3  # order of the local polynomials


def measured_turns(
    model: mujoco.MjModel, recording: Recording, runs: Sequence[Run], windows: Windows, noise: np.ndarray
) -> np.ndarray:
    """`turns` of the joints that `recording` measures, by its `runs`, of which the `windows` are; noise: (ny,)."""
    ways, least = {}, {}
    for column, channel in enumerate(recording.channels):
        sensor = model.sensor(channel.partition("[")[0])
        if sensor.type[0] == int(JOINTPOS):
            dof = int(model.joint(sensor.objid[0]).dofadr[0])
            least[dof] = SURE * float(noise[column])
            ways[dof] = [smooth(run.measured[:, column], float(noise[column])) for run in runs]
    return turns(ways, windows.runs, windows.first, least, model.nv)


def turns(
    ways: Mapping[int, Sequence[np.ndarray]], runs: np.ndarray, first: np.ndarray, least: Mapping[int, float], nv: int
) -> np.ndarray:
    """Positions of each degree of freedom at the start of its run, where it has turned since, and at the start of each
    window, (w, k, nv); NaN: not known. Those that turned less often stay where they are.

    Args:
        ways: positions over all of each run, (T,), by degree of freedom. runs, first: of each window, (w,). least: the
            way back, by degree of freedom, from which it is a turn.
    """
    found = {dof: [_turning(way, least[dof]) for way in own] for dof, own in ways.items()}
    rows = [
        {dof: _until(ways[dof][run], found[dof][run], begin) for dof in ways}
        for run, begin in zip(runs, first, strict=True)
    ]
    longest = max((len(own) for row in rows for own in row.values()), default=1)
    out = np.full((len(rows), longest, nv), np.nan)
    for place, row in zip(out, rows, strict=True):
        for dof, own in row.items():
            place[:, dof] = np.pad(own, (0, longest - len(own)), "edge")
    return out


def _until(way: np.ndarray, turning: np.ndarray, begin: int) -> np.ndarray:
    before = turning[turning < begin][-MOST:]
    return way[[*(before if len(before) else [0]), begin]]


def smooth(signal: np.ndarray, noise: float) -> np.ndarray:
    """`signal`, (T,), without noise: local cubics, the widest whose residual is no more; all NaN where nothing is
    measured."""
    known = np.flatnonzero(np.isfinite(signal))
    if not len(known):
        return signal
    whole = np.interp(np.arange(len(signal)), known, signal[known])
    for width in (width for width in WIDTHS if width < len(signal)):
        found = savgol_filter(whole, width, CUBIC)
        if np.sqrt(np.mean((found - whole)[known] ** 2)) < FITS * noise:
            return found
    return whole


def _turning(way: np.ndarray, least: float) -> np.ndarray:
    """Indices of the start and of all extremes from which `way`, (T,), goes back by more than `least`."""
    found, low, high, last = [0], 0, 0, 0
    bends = 1 + np.flatnonzero(np.diff(np.sign(np.diff(way))))
    for index, value in ((index, way[index]) for index in (*bends, len(way) - 1)):
        low = index if value < way[low] else low
        high = index if value > way[high] else high
        if last <= 0 and value - way[low] > least:  # it rises, and has fallen before
            found, low, high, last = [*found, *([low] if last else [])], index, index, 1
        elif last >= 0 and way[high] - value > least:
            found, low, high, last = [*found, *([high] if last else [])], index, index, -1
    return np.array(found)
