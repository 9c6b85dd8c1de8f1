"""Bounded: a Newton step inside a box."""

import numpy as np


def bounded(hessian: np.ndarray, slope: np.ndarray, scale: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """The step, (k,), that maximises slope @ step - step @ hessian @ step / 2 between `low` <= 0 and `high` >= 0.

    It goes as far as the first bound, which is held from there on, and asks the other coordinates again: those that
    are all cut off where they would leave their bounds no longer match, a mass and its place, say, and lose more than
    they gain. Coordinates of scale 0 stay where they are.
    """
    held, step = ((low >= 0) & (slope < 0)) | ((high <= 0) & (slope > 0)), np.zeros(len(slope))
    for _ in range(len(slope) + 1):
        free = scale * ~held
        pull = (slope - hessian @ step) * free
        move = free * np.linalg.lstsq(hessian * np.outer(free, free), pull, rcond=1e-12)[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(move > 0, (high - step) / move, np.where(move < 0, (low - step) / move, np.inf))
        share = min(1.0, max(float(room.min(initial=np.inf)), 0.0))
        step = np.clip(step + share * move, low, high)
        if share >= 1.0:
            break
        held |= room <= share
    return step
