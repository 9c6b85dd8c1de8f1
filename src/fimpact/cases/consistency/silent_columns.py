"""Columns that show nothing although something moves: dead sensors, readings without gravity, commands never filled."""

from collections.abc import Iterator

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.channels import Channel
from fimpact.cases.consistency.dynamics import dynamics_ties
from fimpact.cases.consistency.kinematics import Log
from fimpact.cases.consistency.sensor_ties import placed
from fimpact.cases.consistency.ties import DECLARED, MODEL_ERROR, ODDS, far_better
from fimpact.cases.runs import FEWEST
from fimpact.recordings import Recording

LONG = 5.0  # s: in half of that a robot that falls freely is 30 m down


def dead_sensors(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    """Sensors that do not change at all in one run, although in it moves what they measure."""
    log = Log.of(recording, model, seen)
    for channel in seen:
        spans = [_span(run.measured[:, log.places[channel.sensor]]) for run in recording.runs]
        for run, span in zip(recording.runs, spans, strict=True):
            mover = _mover(log, channel)
            if span or not max(spans) or mover is None:
                continue
            usual = min(_span(mover(other)) for other, own in zip(recording.runs, spans, strict=True) if own)
            if usual and _span(mover(run)) > 0.5 * usual:
                yield (
                    "constant",
                    f"'{channel.sensor}' does not change in run '{run.name}', unlike in others, although what moves it "
                    "does; correct its column, or remove the run",
                )


def weightless(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    """Accelerometers whose orientation nothing shows: on a robot that stays where it is, acceleration in the world is
    none on average, so that the mean of what they read cannot be shorter than gravity."""
    log, weight = Log.of(recording, model, seen), float(np.linalg.norm(model.opt.gravity))
    for channel in seen:
        if channel.type != enums.ACCELEROMETER or placed(log, channel, log.columns()):
            continue
        for run in recording.runs:
            sizes = np.linalg.norm(run.measured[:, log.places[channel.sensor]], axis=1)
            if len(sizes) * recording.period > LONG and np.nanmean(sizes) < weight / 2:
                yield (
                    "gravity",
                    f"'{channel.sensor}' reads {np.nanmean(sizes):.3g} m/s^2 on average in run '{run.name}', but on a "
                    f"robot that does not fall it reads {weight:.3g} or more: gravity was taken out, or it is in g; "
                    "log the raw acceleration, or correct its unit",
                )


def _span(values: np.ndarray) -> float:
    """By how much columns (T, k) change, inf if next to nothing of them is known."""
    known = values[np.isfinite(values).all(axis=1)]
    return float(np.ptp(known, axis=0).max()) if len(known) > FEWEST else np.inf


def _mover(log: Log, channel: Channel):
    """Columns, of a run, of what makes a sensor change: the commands of its joint, or all positions."""
    positions = [log.places[one.sensor] for one in log.seen if one.type == enums.JOINTPOS and one != channel]
    drives = [
        actuator
        for actuator in range(log.model.nu)
        if channel.joint
        and int(log.model.actuator_trntype[actuator]) in enums.AT_JOINT
        and log.model.joint(int(log.model.actuator_trnid[actuator, 0])).name == channel.joint
    ]
    if drives:
        return lambda run: run.ctrl[:, drives]
    if not channel.joint and positions:
        return lambda run: run.measured[:, [place[0] for place in positions]]
    return None


def unfilled_commands(log: Log) -> Iterator[tuple[str, str]]:
    """Commands that are 0 in one run, in which the robot moves as nothing but a command can make it."""
    ctrl = [np.concatenate([log.recording.runs[run].ctrl for run in group]) for group in log.groups]
    for tie in dynamics_ties(log) if any(not one.any(axis=0).all() for one in ctrl) else ():
        left = [tie.left(DECLARED, group) for group in range(len(log.groups))]
        for actuator in range(log.model.nu if tie.slack == MODEL_ERROR else 0):
            used = [bool(one[:, actuator].any()) for one in ctrl]
            good = [one.share for one, full in zip(left, used, strict=True) if full]
            for name, one, full in zip(log.names, left, used, strict=True):
                usual = float(np.median(good)) if good and not full else one.share
                gain = 0.5 * one.independent * np.log(one.share / max(usual, 1e-12))
                if far_better(one.share, usual, MODEL_ERROR) and gain > ODDS + np.log(len(left) * log.model.nu):
                    line = f"the command of '{log.model.actuator(actuator).name}' is 0 throughout run '{name}', but the"
                    yield "silent", f"{line} motion there needs it: it was never filled; correct it, or remove the run"
