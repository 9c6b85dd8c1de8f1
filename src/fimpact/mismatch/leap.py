"""Leap: long steps, where a tangent does not reach: through contacts, and out of an optimum that is not the best."""

from collections.abc import Collection

import numpy as np

from fimpact.mismatch.coordinates import Coordinates
from fimpact.mismatch.problem import Point, Problem
from fimpact.mismatch.settle import better, settled

STRIDES = (-0.7, 2.0)  # of a coordinate or its scale: the longest steps, tried first
FAR, LEAPS = 0.3, 12  # the same: the first long step after those; how many are tried
ON, BACK = 2.0, -0.5  # what a long step that paid is multiplied by, and one that did not
BRIEFLY = 4  # iterations on initial states after a long step


def leaped(problem: Problem, coordinates: Coordinates, point: Point, along: Collection[int] | None = None) -> Point:
    """Long steps along one coordinate after the other, longer while that pays: a tangent through a contact holds for
    less than a step that would be worth while, and around an optimum of its own nothing shows what lies further off."""
    for i in range(len(coordinates.scale)) if along is None else along:
        z = coordinates.read(point.hypothesis)
        size = max(coordinates.scale[i], abs(z[i]))
        strides = [leap(problem, coordinates, point, i, stride * size) for stride in STRIDES]
        point = min([point, *strides], key=lambda p: p.cost)
        step = FAR * max(coordinates.scale[i], abs(coordinates.read(point.hypothesis)[i]))
        for _ in range(LEAPS):
            trial = leap(problem, coordinates, point, i, step)
            paid = trial.cost < point.cost
            point = trial if paid else point
            step *= ON if paid else BACK
    return point


def leap(problem: Problem, coordinates: Coordinates, point: Point, i: int, step: float) -> Point:
    """`point` with coordinate `i` moved by `step`, each window begun where it was or as measured, whichever is better
    there, and settled."""
    z = coordinates.read(point.hypothesis)
    there = coordinates.write(point.hypothesis, z + step * (np.arange(len(z)) == i))
    starts = (point.qpos, point.qvel), problem.starts
    begun = better(*(problem.evaluate(there, *states, coordinates) for states in starts))
    return settled(problem, coordinates, begun, BRIEFLY)
