"""The tie of a joint's angle and its motor's command, were the columns of the two exchanged."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fimpact.cases import enums
from fimpact.cases.consistency.dynamics import dynamics_ties
from fimpact.cases.consistency.kinematics import Log
from fimpact.cases.consistency.ties import DECLARED, MODEL_ERROR, Left, Reading, Tie


def exchange_ties(log: Log) -> Iterator[Tie]:
    """Whether dynamics balance far better with the numbers of a motor's command and of its joint's angle exchanged."""
    own = next(dynamics_ties(log), None)
    if own is None:
        return
    pairs = list(_pairs(log))
    others = {_reading(log, *pair): next(dynamics_ties(_exchanged(log, *pair))) for pair in pairs}

    def left(reading: Reading, group: int) -> Left:
        return others.get(reading, own).left(DECLARED, group)

    if others:
        yield Tie(own.what, log.names, tuple(others), left, MODEL_ERROR)


def _pairs(log: Log) -> Iterator[tuple[int, int]]:
    """A motor, no servo, and the column of the angle of the joint that it drives."""
    model, columns = log.model, log.columns()
    for motor in np.flatnonzero(model.actuator_biastype == enums.NO_BIAS):
        place = columns.get(model.joint(model.actuator_trnid[motor, 0]).name, ())
        if model.actuator_trntype[motor] in enums.AT_JOINT and len(place) == 1:
            yield int(motor), place[0]


def _reading(log: Log, motor: int, column: int) -> Reading:
    command, angle = log.model.actuator(motor).name, log.recording.channels[column]
    return Reading(
        f"the columns of '{angle}' and of the command of '{command}' are swapped", "swapped", "exchange them"
    )


def _exchanged(log: Log, motor: int, column: int) -> Log:
    runs = []
    for run in log.recording.runs:
        ctrl, measured = run.ctrl.copy(), run.measured.copy()
        ctrl[:, motor], measured[:, column] = run.measured[:, column], run.ctrl[:, motor]
        runs.append(replace(run, ctrl=ctrl, measured=measured))
    return replace(log, recording=replace(log.recording, runs=tuple(runs)))
