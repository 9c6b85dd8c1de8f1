"""Whether a recording can be what it says it is: each doubt is one line that names the likely cause."""

from collections.abc import Iterator
from itertools import product

import mujoco
import numpy as np

from fimpact.cases import enums
from fimpact.cases.channels import Channel, Command
from fimpact.cases.consistency import columns_alone
from fimpact.cases.consistency.dynamics import dynamics_ties
from fimpact.cases.consistency.exchanged import exchange_ties
from fimpact.cases.consistency.kinematics import Log, speed_ties
from fimpact.cases.consistency.sensor_ties import sensor_ties
from fimpact.cases.consistency.servo_ties import servo_ties
from fimpact.cases.consistency.silent_columns import dead_sensors, unfilled_commands, weightless
from fimpact.cases.consistency.ties import doubt, note
from fimpact.cases.errors import CaseError
from fimpact.cases.raw_runs import Source, find
from fimpact.cases.readers.columns import Column
from fimpact.cases.runs import FEWEST, ResampledRun
from fimpact.recordings import Recording

NOTHING = 1e-12  # of anything measured, in SI units
LOUDEST = 3.0  # times all that is read: a noise that is declared so cannot be
DEGREES, THOUSAND = 180 / np.pi, 1000.0


def check_sources(runs: list[Source]) -> None:
    """Judge the runs before they are sampled.

    Raises:
        CaseError: nothing to train on or to hold out.
    """
    training, held = _roles(runs)
    if not training:
        raise CaseError(f"runs: all {len(runs)} runs are held out; allowed: at least one to fit; remove a `held_out`")
    if not held:
        raise CaseError(
            f"runs: none of {len(runs)} runs is held out; only held-out runs can judge a model; "
            "write `held_out: true` on at least one"
        )


def check_rows(runs: list[Source], used: list[str | int]) -> None:
    """Whether no row of the `used` columns is both for training and held out.

    Raises:
        CaseError: some are.
    """
    columns = {run.name: [find(run.table, name, run.where) for name in used] for run in runs}
    training, held = _roles(runs)
    for one, other in product(held, training):
        both = list(zip(columns[one.name], columns[other.name], strict=True))
        apart = one.start >= other.stop or other.start >= one.stop
        if all(_meet(a, b) for a, b in both) and not (apart and all(_same(a.rows, b.rows) for a, b in both)):
            raise CaseError(
                f"held-out run '{one.name}' and training run '{other.name}' are the same rows of {one.files[0].name}; "
                "allowed: other runs, or, of one `select`, `start` and `stop` that do not overlap"
            )


def _roles(runs: list[Source]) -> tuple[list[Source], list[Source]]:
    return [run for run in runs if not run.held_out], [run for run in runs if run.held_out]


def _meet(one: Column, other: Column) -> bool:
    if one.origin != other.origin:
        return False
    return one.rows is None or other.rows is None or bool(np.intersect1d(one.rows, other.rows).size)


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))


def check_columns(runs: list[ResampledRun], commands: list[Command], seen: list[Channel], accept: set[str]) -> None:
    """Judge the columns of each run as they stand in its rows.

    Raises:
        CaseError: the first thing that cannot be right.
    """
    for run in runs:
        for kind, complaint in columns_alone.doubts(run.source.name, commands, run.commands, seen, run.measured):
            _refuse(kind, complaint, accept)


def _refuse(kind: str, complaint: str, accept: set[str]) -> None:
    if kind not in accept:
        raise CaseError(f"{complaint}; if it is meant, write `accept: [{kind}]`")


def check_recording(recording: Recording, model: mujoco.MjModel, seen: list[Channel], accept: set[str]) -> list[str]:
    """Judge a recording on its grid.

    Args:
        model: compiled naive model. seen: its channels. accept: doubts that the case says are meant.

    Returns:
        Lines about what is unusual and may be right.

    Raises:
        CaseError: the first thing that cannot be right.
    """
    notes = []
    for check in (_lengths, _same_runs, _noises):
        for line in check(recording):
            raise CaseError(line)
    for doubts in (_still, dead_sensors, weightless, _cutoffs, _ties, _ranges):
        for kind, complaint in doubts(recording, model, seen):
            if kind:
                _refuse(kind, complaint, accept)
            else:
                notes.append(complaint)
    if recording.window and round(recording.window / recording.period) < FEWEST:
        raise CaseError(
            f"window is {recording.window:g} s, less than {FEWEST} samples of {recording.period:.6g} s; "
            "allowed: longer ones, or 0 for whole runs; make it longer"
        )
    return notes


def fewest(window: float, period: float) -> int:
    """Samples of the shortest run that can be used."""
    return max(FEWEST, round(window / period) + 1)


def _lengths(recording: Recording) -> Iterator[str]:
    least = fewest(recording.window, recording.period)
    for run in recording.runs:
        if len(run.measured) < least:
            yield (
                f"run '{run.name}' has {len(run.measured)} samples of {recording.period:.6g} s, "
                f"{len(run.measured) * recording.period:.4g} s in all; allowed: {least} or more "
                f"(window {recording.window:g} s); remove it, make the window shorter, or correct time.unit"
            )


def _same_runs(recording: Recording) -> Iterator[str]:
    seen: dict[bytes, str] = {}
    for run in recording.training:
        seen[run.measured.tobytes()] = run.name
    for run in recording.held_out:
        if run.measured.tobytes() in seen:
            yield (
                f"held-out run '{run.name}' and training run '{seen[run.measured.tobytes()]}' hold the same numbers; "
                "a copy judges nothing; hold out another recording"
            )


def _noises(recording: Recording) -> Iterator[str]:
    for name, noise in zip(recording.channels, recording.noise, strict=True):
        spread = float(np.nanstd(_values(recording, name))) if np.isfinite(_values(recording, name)).any() else 0.0
        if 0 < LOUDEST * spread < noise:
            yield (
                f"the noise of '{name}' is declared as {noise:.4g} in SI units, but all that it reads, motion "
                f"included, has a standard deviation of {spread:.4g}; allowed: less; correct `noise`, or remove it"
            )


def _still(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    for channel in seen:
        values = np.column_stack([_values(recording, name) for name in channel.names])
        known = values[np.isfinite(values).all(axis=1)]
        if not np.abs(known).max(initial=0.0) > NOTHING:
            what = "0" if len(known) else "absent"
            yield "silent", f"'{channel.sensor}' is {what} in every run: a silent sensor; correct its column"
        elif not np.ptp(known, axis=0).any():
            yield "constant", f"'{channel.sensor}' is constant, {known[0, 0]:.6g} in every run; correct its column"
    ctrl = np.concatenate([run.ctrl for run in recording.runs])
    for actuator, values in enumerate(ctrl.T):
        if np.ptp(values) <= 1e-9 * np.abs(values).max():  # but for what rounding does to means over a period
            name = model.actuator(actuator).name
            yield "constant", f"the command of '{name}' is constant, {values[0]:.6g} in every run; correct its column"


def _ranges(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    for channel in seen:
        joint = model.joint(channel.joint) if channel.type == enums.JOINTPOS else None
        if joint is not None and model.jnt_limited[joint.id]:
            values = _values(recording, channel.sensor)
            units = DEGREES if joint.type[0] == enums.HINGE else THOUSAND
            yield from _outside(f"'{channel.sensor}'", values, joint.range, units, "the joint's range")
    for actuator in np.flatnonzero(model.actuator_ctrllimited):
        values = np.concatenate([run.ctrl[:, actuator] for run in recording.runs])
        what = f"the command of '{model.actuator(actuator).name}'"
        yield from _outside(what, values, model.actuator_ctrlrange[actuator], THOUSAND, "the actuator's range")


def _cutoffs(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    for channel in seen:
        cutoff = model.sensor(channel.sensor).cutoff[0]
        values = np.concatenate([_values(recording, name) for name in channel.names])
        largest = np.nanmax(np.abs(values), initial=0.0)
        if 0 < cutoff < largest:
            yield (
                "range",
                f"'{channel.sensor}' reads up to {largest:.4g}, but its sensor in the MJCF is cut off at {cutoff:.4g}; "
                "correct the unit, or the cutoff in the MJCF",
            )


def _outside(what: str, values: np.ndarray, limits, units: float, which: str) -> Iterator[tuple[str, str]]:
    slack = 0.1 * (limits[1] - limits[0])
    low, high = np.nanmin(values), np.nanmax(values)
    if low >= limits[0] - slack and high <= limits[1] + slack:
        return
    got = f"{what} goes from {low:.4g} to {high:.4g}, but {which} is {limits[0]:.4g} to {limits[1]:.4g}"
    fits = low / units >= limits[0] - slack and high / units <= limits[1] + slack
    if fits and high - low > 0.05 * units * (limits[1] - limits[0]):
        cause = "it is in degrees but declared as radians" if units == DEGREES else "its unit is wrong by 1000"
        yield "units", f"{got}: {cause}; correct its unit"
    else:
        yield "range", f"{got}; correct the unit or column, or the range in the MJCF"


def _values(recording: Recording, name: str) -> np.ndarray:
    column = recording.channels.index(name)
    return np.concatenate([run.measured[:, column] for run in recording.runs])


def _ties(recording: Recording, model: mujoco.MjModel, seen: list[Channel]) -> Iterator[tuple[str, str]]:
    """What kinematics and dynamics tie together, the exact laws first; a line of the kind "" is but a note."""
    log = Log.of(recording, model, seen)
    for ties in (speed_ties, sensor_ties, servo_ties, dynamics_ties, exchange_ties):
        for tie in ties(log):
            found, late = doubt(tie), note(tie)
            if found:
                yield found[0].doubt, found[1]
            elif late:
                yield "", late
    yield from unfilled_commands(log)
