"""Paths as people drive their robots to identify them: periodic multisines, ramps, moves one way, hops."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

CENTRE = np.array([0.0, 0.3, 0.8, 0.2, 0.3, 0.0])  # rad, of the six axes
DESK = np.array([0.0, 0.2, 0.3, 0.2, 0.0, 0.3])  # rad, of the six servos
BENT, SHIN, FOOT = 1.0, 0.25, 0.02  # rad, m, m: the leg's knee as it stands, both its links, its foot


def multisine(rng, time, centre, size, fast):
    """Harmonics of the run's own length, the least crest of a few draws of phases, (T, nu), rad."""
    order = np.arange(1, 5 if fast else 4)
    found = [_periodic(rng, time, order, len(centre)) for _ in range(8)]
    path = min(found, key=lambda own: np.abs(own).max())
    return centre + size * path / np.sqrt(np.mean(path**2))


def _periodic(rng, time, order, count):
    phases = rng.uniform(0, 2 * np.pi, (len(order), count))
    turns = 2 * np.pi * time[:, None, None] / (time[-1] + time[1])
    return (np.sin(turns * order[:, None] + phases) / order[:, None]).sum(1)


def ramps(rng, time, centre, size, fast):
    """Constant speeds between random points, rounded where they meet, (T, nu), rad."""
    knots = 6 if fast else 4
    sides = np.where(np.arange(knots) % 2, 1, -1)[:, None] * rng.choice([-1, 1], len(centre))
    points = sides * rng.uniform(0.4, 1.8, (knots, len(centre)))
    at = np.linspace(0, time[-1], knots)
    path = np.stack([np.interp(time, at, own) for own in points.T], axis=1)
    return centre + size * gaussian_filter1d(path, len(time) / 40, axis=0, mode="nearest")


def one_move(rng, time, centre, size, fast):
    """One move of least jerk from a rest to another, each joint at its own time, (T, nu), rad."""
    begin, way = rng.choice([-1, 1], len(centre)) * np.stack(
        [-rng.uniform(0.5, 1.5, len(centre)), np.ones(len(centre))]
    )
    last = time[-1] * rng.uniform(0.5 if fast else 0.75, 0.8 if fast else 1.0, len(centre))
    part = np.clip(time[:, None] / last, 0, 1)
    return centre + size * (begin + 2 * way * part**3 * (10 - 15 * part + 6 * part**2))


def six_axis(rng, time, fast, run):
    """A run of the arm of six axes, its kind by its number, (T, 6), rad."""
    kind = (multisine, ramps, one_move)[run % 3]
    return kind(rng, time, CENTRE, np.array([0.2, 0.15, 0.2, 0.25, 0.25, 0.3]), fast)


def six_servo(rng, time, fast, run):
    """Targets of the arm of six servos, with jumps that a gripper or a teacher makes, (T, 6), rad."""
    path = (multisine, ramps)[run % 2](rng, time, DESK, np.full(6, 0.35), fast)
    jumps = np.zeros_like(path)
    for column in jumps.T:
        at = rng.choice(np.arange(10, len(time) - 10), 4, replace=False)
        column[at] = rng.uniform(0.05, 0.15, 4) * np.array([1, -1, 1, -1]) * rng.choice([-1, 1])
    return path + np.cumsum(jumps, axis=0)


def leg(rng, time, fast, run):
    """Targets of hip and knee, (T, 2), rad: a stance, hops, slides of the foot along the floor, by the run's number."""
    quick, phase = (1.4 if fast else 1.0), rng.uniform(0, 2 * np.pi, 3)
    turns = 2 * np.pi * time
    kind = run % 3
    depth, rate = ((0.25, 2.5), (0.5, 2.6), (0.15, 2.0))[kind]
    knee = BENT + depth * rng.uniform(0.8, 1.2) * np.sin(quick * rate * turns * rng.uniform(0.9, 1.1) + phase[0])
    lean = rng.uniform(0.05, 0.1) * np.sin(quick * 1.7 * turns + phase[1])
    if kind == 2:
        lean = rng.uniform(0.25, 0.35) * np.sin(quick * 2.2 * turns + phase[2])
    return np.stack([-knee / 2 + lean, knee], axis=1)


def standing(targets):
    """Where the leg is as its run begins, (3,): the foot at the floor."""
    hip, knee = targets
    return np.array([SHIN * (np.cos(hip) + np.cos(hip + knee)) + FOOT, hip, knee])
