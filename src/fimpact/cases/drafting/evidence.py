"""Units told by values: of a time by how it goes on, of positions by the ranges that the MJCF gives their joints."""

from collections.abc import Sequence

import numpy as np

from fimpact.cases.drafting.column_names import OPEN

CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
EPOCH = 9e8, 5e9  # s since 1970, of 1998 to 2128
SLOW = 10.0  # s, at most between samples since 1970
STEPS = 2.5e-4, 0.25  # s between samples, so that no two of the units fit
OTHER = {"rad": ("deg", np.pi / 180), "m": ("mm", 1e-3)}
SLACK = 0.1  # of a range, by which readings may leave it
MOVED = 0.05  # of their ranges, that joints in a log move at least
SHARE, GRIPPER_SHARE = "-100..100", "0..100"
FULL = 0.025  # of a range, by which a share of it may leave it, where a joint gives way at its end
TURN = 360.0
TICKS = 4095, 4096  # of a turn of a servo's encoder

ALIKE, APART = 0.9, 0.2  # correlation of a command with what follows it, and by how much it is above the others
Moving = tuple[np.ndarray, np.ndarray]  # times and values
Bounded = tuple[np.ndarray, tuple[float, float] | None]  # values, and the range of their joint in SI


def time_unit(values: np.ndarray) -> tuple[str, str]:
    """The unit of a time and why; else `OPEN`."""
    known = values[np.isfinite(values)]
    steps = np.diff(known)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for unit, scale in CLOCKS.items():
        if known.size and EPOCH[0] < known.min() * scale < EPOCH[1] and step * scale < SLOW:
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
    if wanted == "rad" and _fits(limited, scale) and all(_ticks(values) for values, _ in columns):
        return other, "they are whole steps of an encoder of 4096 a turn"
    widths = [(np.ptp(values), limits[1] - limits[0]) for values, limits in limited]
    moved = {
        wanted: float(np.median([went / width for went, width in widths])) * _fits(limited, 1.0),
        other: float(np.median([scale * went / width for went, width in widths])) * _fits(limited, scale),
        SHARE: float(np.median([went / 200 for went, _ in widths]))
        * _fits([(v, (-100.0, 100.0)) for v, _ in limited], 1.0, FULL),
    }
    fitting = [unit for unit, share in moved.items() if share > MOVED]
    if len(fitting) == 1:
        return fitting[0], f"joints then move over {moved[fitting[0]]:.0%} of their ranges, and nothing else fits these"
    if fitting:
        said = " and ".join(fitting).replace(SHARE, f"{SHARE} (of the joint's range)")
        return OPEN, f"{said} fit the joints' ranges alike; write what the recorder was set to"
    return OPEN, f"{wanted}, {other} and {SHARE} all leave the joints' ranges, or joints would hardly move"


def may_be_share(values: np.ndarray) -> bool:
    """Whether readings of a gripper can be its opening in percent."""
    return _fits([(values, (0.0, 100.0))], 1.0)


def share_unit(columns: Sequence[Bounded], wanted: str) -> tuple[str, str]:
    """The unit of grippers that may be open by so many percent, and why; else `OPEN`."""
    limited = [(values[np.isfinite(values)], limits) for values, limits in columns if limits]
    other, scale = OTHER[wanted]
    if limited and not _fits(limited, scale):
        return GRIPPER_SHARE, f"in {other} they leave the joint's range"
    return OPEN, f"{other} and {GRIPPER_SHARE} (of the joint's range) fit alike; write what the recorder was set to"


def alike(commands: dict[str, Moving], positions: dict[str, Moving]) -> tuple[dict[str, float], dict[str, str]]:
    """How well each joint follows its command (correlation), and the joint that follows it far better, where one does.

    Args:
        commands, positions: of servos' joints, by the joint.
    """
    own, other = {}, {}
    for joint in commands.keys() & positions.keys():
        follow = {name: _correlation(commands[joint], position) for name, position in positions.items()}
        best = max(follow, key=follow.__getitem__)
        own[joint] = follow[joint]
        if follow[best] > max(ALIKE, follow[joint] + APART):
            other[joint] = best
    return own, other


def _correlation(command: Moving, position: Moving) -> float:
    """Of a command and a position at the position's times, where both are known."""
    if command[0] is position[0]:  # of one table; its time may begin again with each run
        known = np.isfinite(command[1]) & np.isfinite(position[1])
        return _of_both(command[1][known], position[1][known])
    kept = [np.isfinite(times) & np.isfinite(values) for times, values in (command, position)]
    (at, given), (when, seen) = ((t[k], v[k]) for (t, v), k in zip((command, position), kept, strict=True))
    inside = (when >= at.min(initial=np.inf)) & (when <= at.max(initial=-np.inf))
    return _of_both(np.interp(when[inside], at, given), seen[inside]) if inside.any() else 0.0


def _of_both(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one, other)[0, 1]) if len(one) > 2 and np.ptp(one) > 0 and np.ptp(other) > 0 else 0.0


def _fits(columns: Sequence[tuple[np.ndarray, tuple[float, float]]], scale: float, beyond: float = SLACK) -> bool:
    for values, (low, high) in columns:
        slack = beyond * (high - low)
        if np.nanmin(values) * scale < low - slack or np.nanmax(values) * scale > high + slack:
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
