"""Measured angles: a sensor that starts again after a turn shows jumps that no joint makes."""

import numpy as np

from fimpact.cases.channels import Channel
from fimpact.cases.resampling import Series

TURN = 2 * np.pi
JUMP = 0.8 * TURN  # between two samples; a joint this quick would turn on, and leave the range of one turn
SMALL = 0.25 * TURN  # what all other steps are at most: of a joint, not of noise
WITHIN = 1.01 * TURN  # range of a sensor that knows one turn


def unwrapped(seen: list[Series | None], channels: list[Channel]) -> list[Series | None]:
    """The series of all columns, (ny), in rad, with hinge positions that start again after a turn made continuous."""
    hinges = [channel.turns for channel in channels for _ in channel.columns]
    return [
        Series(one.time, np.unwrap(one.value)) if one and turns and _wraps(one.value) else one
        for one, turns in zip(seen, hinges, strict=True)
    ]


def _wraps(angle: np.ndarray) -> bool:
    if np.ptp(angle) > WITHIN:
        return False
    steps = np.abs(np.diff(angle))
    jumps = steps > JUMP
    return bool(jumps.any() and np.all(jumps | (steps < SMALL)))
