"""What a column is by its words: commanded or measured, and of what quantity."""

from dataclasses import dataclass

from fimpact.cases.drafting.column_names import OPEN, unit, words
from fimpact.cases.readers.columns import SI, Column

COMMANDED = set(
    "action actions cmd cmds command commands commanded ctrl control demand des desired ref reference references "
    "target targets goal setpoint setpoints sp wish qdes qref qcmd input inputs output trajectory".split()
)
MEASURED = set(
    "observation observations obs state states present actual act meas measured measurement measurements feedback fb "
    "fbk encoder enc qmeas".split()
)
NEITHER = {"error", "errors", "err"}
QUANTITIES = {  # in this order: the angle's velocity is a velocity
    "acceleration": set("acc accel acceleration accelerations qdd ddq qacc".split()),
    "velocity": set("vel velocity velocities speed speeds rate qd dq qvel omega thetadot rpm".split()),
    "effort": set("tau torque torques force effort efforts voltage volt volts u con pwm".split()),
    "position": set("pos position positions angle angles q qpos theta phi encoder height qdes qref qcmd qmeas".split()),
}
CURRENT = {"current", "currents", "amps"}  # of a motor, unless it is the current position
KNOWN = COMMANDED | MEASURED | NEITHER | CURRENT | set().union(*QUANTITIES.values())
OF_UNIT = dict.fromkeys(("deg/s", "rad/s", "mm/s", "m/s", "rpm"), "velocity")
OF_UNIT |= dict.fromkeys(("mN m", "N m", "Nm", "N", "V", "A"), "effort")
OF_UNIT |= dict.fromkeys(("deg", "rad", "rev", "mm", "m"), "position")


@dataclass(frozen=True)
class Role:
    """side: "commanded", "measured", "neither", or "" where no word tells; quantity: a key of `QUANTITIES`, or ""."""

    side: str
    quantity: str


def told_unit(column: Column) -> str:
    """The unit that a column's file or name tells; else `OPEN`."""
    told = unit(f"[{column.unit}]") if column.unit not in ("", SI) else OPEN
    return told if told != OPEN else unit(column.name)


def role(column: Column) -> Role:
    """The role of a column by its own words, else by those of its topic."""
    own, topic = words(column.name), words(column.group) if column.group.startswith("/") else set()
    quantity = _quantity(own) or OF_UNIT.get(told_unit(column), "") or _quantity(topic)
    return Role(_side(own, quantity) or _side(topic, quantity), quantity)


def _side(said: set[str], quantity: str) -> str:
    if said & NEITHER:
        return "neither"
    if said & COMMANDED:
        return "commanded"
    return "measured" if said & MEASURED or (said & CURRENT and quantity in ("position", "velocity")) else ""


def _quantity(said: set[str]) -> str:
    found = [quantity for quantity, known in QUANTITIES.items() if said & known]
    return (found or ["effort" if said & CURRENT else ""])[0]
