"""Units told by values: of a time by how it goes on, of positions by the ranges that the MJCF gives their joints."""

from collections.abc import Sequence

import numpy as np

from fimpact.cases.names import OPEN

CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = 9e8, 5e9  # s since 1970, of 1998 to 2128
STEPS = 2.5e-4, 0.25  # s between samples, so that no two of the units fit
OTHER = {"rad": ("deg", np.pi / 180), "m": ("mm", 1e-3)}
SLACK = 0.1  # of a range, by which readings may leave it
MOVED = 0.05  # of their ranges, that joints in a log move at least
SHARE, GRIPPER_SHARE = "-100..100", "0..100"
TURN = 360.0
TICKS = 4095, 4096  # of a turn of a servo's encoder

Bounded = tuple[np.ndarray, tuple[float, float] | None]  # values, and the range of their joint in SI


def time_unit(values: np.ndarray) -> tuple[str, str]:
    """The unit of a time and why; else `OPEN`."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for unit, scale in CLOCKS.items():
        if known.size and EPOCH[0] < np.median(known) * scale < EPOCH[1]:
            return unit, f"it counts from 1970, by {step:.4g}"
    counted = step == 1.0 and np.array_equal(known, np.round(known))
    fitting = [unit for unit, scale in CLOCKS.items() if STEPS[0] < step * scale <= STEPS[1]]
    if fitting and not counted:
        return fitting[0], f"it goes on by {step:.4g}, {1 / (step * CLOCKS[fitting[0]]):.4g} Hz"
    return OPEN, "it counts samples" if counted else f"it goes on by {step:.4g}"


def position_unit(columns: Sequence[Bounded], wanted: str) -> tuple[str, str]:
    """The unit of the positions of joints and why; else `OPEN`.

    Args:
        columns: of one unit. wanted: unit of the MJCF, rad or m.
    """
    limited = [(values[np.isfinite(values)], limits) for values, limits in columns if limits]
    limited = [(values, limits) for values, limits in limited if len(values)]
    if not limited:
        return OPEN, "the MJCF gives their joints no range to judge by"
    other, scale = OTHER[wanted]
    if _fits(limited, 1.0):
        share = float(np.median([np.ptp(values) / (limits[1] - limits[0]) for values, limits in limited]))
        if share > MOVED:
            return wanted, f"they move over {share:.0%} of the joints' ranges, in {other} over {share * scale:.1%}"
        return OPEN, f"they move over {share:.1%} of the joints' ranges only"
    scaled = _fits(limited, scale)
    normalised = all(np.abs(values).max() <= 100.5 for values, _ in limited)
    if wanted == "rad" and scaled and all(_ticks(values) for values, _ in columns):
        return other, "they are whole steps of an encoder of 4096 a turn"
    if scaled and normalised:
        return OPEN, f"{other} or {SHARE} (of the joint's range) fit the joints' ranges alike"
    if scaled or normalised:
        failing = wanted if scaled else f"{wanted} and in {other}"
        return (other if scaled else SHARE), f"in {failing} they leave the joints' ranges"
    return OPEN, f"in {wanted} and in {other} they leave the joints' ranges"


def share_unit(columns: Sequence[Bounded], wanted: str) -> tuple[str, str]:
    """The unit of grippers and why, where other joints are no longer in the MJCF's unit; else `OPEN`."""
    limited = [(values[np.isfinite(values)], limits) for values, limits in columns if limits]
    shares = all(np.nanmin(values) > -0.5 and np.nanmax(values) < 100.5 for values, _ in columns)
    if not shares:
        return position_unit(columns, wanted)
    other, scale = OTHER[wanted]
    if limited and not _fits(limited, scale):
        return GRIPPER_SHARE, f"in {other} they leave the joint's range"
    return OPEN, f"{GRIPPER_SHARE} (of the joint's range) or {other} fit alike"


def _fits(columns: Sequence[Bounded], scale: float) -> bool:
    for values, (low, high) in columns:
        slack = SLACK * (high - low)
        if values.min() * scale < low - slack or values.max() * scale > high + slack:
            return False
    return True


def _ticks(values: np.ndarray) -> bool:
    """Whether angles in degrees are whole steps of a servo's encoder."""
    known = np.unique(values[np.isfinite(values)])
    for ticks in TICKS:
        steps = (known - known[0]) * ticks / TURN if known.size else known
        if known.size >= 20 and np.abs(steps - np.round(steps)).max() < 0.02:
            return True
    return False
