"""The ties of each servo's command and what its joint did: it goes where it was told, and never before."""

from collections.abc import Iterator
from dataclasses import dataclass

from fimpact.cases import enums
from fimpact.cases.consistency.kinematics import APART, CLOCK, DEGREES, THOUSAND, Log, Parts, lag, shifted
from fimpact.cases.consistency.measured_motion import derivative, filled
from fimpact.cases.consistency.ties import MODEL_ERROR, NOTHING, Left, Reading, Tie, unexplained

SERVO = 2.0  # a servo under load may go that many times too far or short
SERVO_LATE = 0.3  # s: of a servo that is slow, filtered or told over a bus
AHEAD = Reading(
    "commands and measurements are exchanged, or the clock of the commands is late: the motion comes before what was "
    "told",
    "swapped",
    "exchange the columns, or correct their time",
)


def servo_ties(log: Log) -> Iterator[Tie]:
    """The target of each position or velocity servo against what its joint did."""
    told = {}
    for actuator in range(log.model.nu):
        target = _target(log, actuator)
        if target:
            told[actuator] = target
    for actuator in told:
        yield _cause_tie(log, actuator, told[actuator])
        yield _servo_tie(log, actuator, told)


@dataclass(frozen=True)
class Target:
    """What a servo is told: the columns of its joint, whose derivative that is, and its control in units of those."""

    sensor: str
    joint: str
    rate: bool
    per_control: float


def _target(log: Log, actuator: int) -> Target | None:
    model = log.model
    bias, gain = model.actuator_biasprm[actuator], model.actuator_gainprm[actuator, 0]
    kind, fixed = int(model.actuator_biastype[actuator]), int(model.actuator_gaintype[actuator])
    if int(model.actuator_trntype[actuator]) not in enums.AT_JOINT or (kind, fixed) != (enums.AFFINE, enums.FIXED):
        return None
    joint = model.joint(int(model.actuator_trnid[actuator, 0])).name
    gear, rate = model.actuator_gear[actuator, 0], bias[1] == 0
    follows = -bias[2] if rate else -bias[1]
    wanted = [c for c in log.seen if c.joint == joint]
    chosen = [c for c in wanted if (c.type == enums.JOINTVEL) == rate] or (wanted if rate else [])
    if not chosen or not gear or follows <= 0:
        return None
    derived = rate and chosen[0].type == enums.JOINTPOS
    return Target(chosen[0].sensor, joint, derived, gain / follows / gear)


def _servo_tie(log: Log, actuator: int, told: dict[int, Target]) -> Tie:
    target, name, period = told[actuator], log.model.actuator(actuator).name, log.recording.period
    swaps = {
        Reading(f"it is told to '{log.model.actuator(o).name}': columns are swapped", "swapped", "exchange them"): o
        for o in told
        if o != actuator and told[o].rate == target.rate
    }
    factors = _servo_factors(log, target, name)

    def left(reading: Reading, group: int) -> Left:
        within = (-APART, APART) if reading == CLOCK else (0.0, SERVO_LATE)
        of = swaps.get(reading, actuator)
        scale = told[of].per_control * factors.get(reading, 1.0)
        return _varying(_told_and_done(log, group, target, of, scale), period, within)

    what = f"the command of '{name}' and '{target.sensor}'"
    return Tie(what, log.names, (*factors, *swaps, CLOCK), left, MODEL_ERROR)


def _cause_tie(log: Log, actuator: int, target: Target) -> Tie:
    """An effect comes after its cause: the law has no error of its own."""
    period = log.recording.period

    def left(reading: Reading, group: int) -> Left:
        within = (-SERVO_LATE, -2 * period) if reading == AHEAD else (0.0, SERVO_LATE)
        return _varying(_told_and_done(log, group, target, actuator, target.per_control), period, within)

    what = f"the command of '{log.model.actuator(actuator).name}' and '{target.sensor}', which follows it,"
    return Tie(what, log.names, (AHEAD,), left)


def _told_and_done(log: Log, group: int, target: Target, actuator: int, scale: float) -> Parts:
    out = []
    for run in (log.recording.runs[run] for run in log.groups[group]):
        did = filled(run.measured[:, log.places[target.sensor][0]])
        did = derivative(did, log.recording.period, 1) if target.rate else did
        out.append((did[:, None], scale * run.ctrl[:, [actuator]]))
    return out


def _servo_factors(log: Log, target: Target, name: str) -> dict[Reading, float]:
    """Measured over told, and what it tells."""
    out = {
        Reading(f"'{target.sensor}' or the command of '{name}' has the wrong sign", "sign", "use `scale: -1`"): -1.0,
        Reading(f"the unit of '{target.sensor}' or of the command of '{name}' is wrong by 1000", "units"): THOUSAND,
        Reading(f"the unit of the command of '{name}' or of '{target.sensor}' is wrong by 1000", "units"): 1 / THOUSAND,
    }
    if log.model.joint(target.joint).type[0] == enums.HINGE:
        here, there = f"'{target.sensor}'", f"the command of '{name}'"
        for one, other, factor in ((here, there, DEGREES), (there, here, 1 / DEGREES)):
            cause = f"{one} is in degrees but declared as radians, or {other} is in radians but declared as degrees"
            out[Reading(cause, "units", "correct the unit")] = factor
    return out


def _varying(parts: Parts, period: float, within: tuple[float, float]) -> Left:
    """As `compared`, of what varies alone: under load a servo stands off its target."""
    delay = lag(parts, period, within)
    y, p = shifted(parts, delay)
    if len(y) < 8:
        return NOTHING
    y, p = y - y.mean(axis=0), p - p.mean(axis=0)
    return unexplained([(y[:, 0], [(p[:, 0], 1 / SERVO, SERVO)])], delay * period)
