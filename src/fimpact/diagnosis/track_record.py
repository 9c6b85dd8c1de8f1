"""How often answers like this one were right, blind, on the simulated robot that is most like the one at hand."""

import mujoco

from fimpact.diagnosis.blind_record import rows
from fimpact.diagnosis.pipeline import NONE, UNNAMED, Diagnosis
from fimpact.effects.touching import can_touch
from fimpact.effects.wiring import has_servos

AXES = 5  # motors from which an arm is rather like that with six than like that with three
RIGS = {
    "arm_free": "a planar arm with three torque motors",
    "arm_contact": "a planar arm that presses on a wall",
    "block": "a thrown block",
    "six_axis": "an arm with six torque motors",
    "six_servo": "an arm with six servos",
    "leg": "a leg that stands, hops and slides",
}


def track_record(diagnosis: Diagnosis) -> str:
    """One sentence for the page; "" where the benchmark had no such answer."""
    rig, asked = rig_like(diagnosis.prepared.track.model, diagnosis.prepared.track.simulator.apart), _asked(diagnosis)
    row = rows().get(rig, {})
    if asked is None or not int(row.get(asked[0], 0)):
        return ""
    count, good, text = asked
    return (
        f"In the blind benchmark, on {RIGS[rig]}, which of its robots is most like yours, "
        f"{text.format(good=row[good], count=row[count])}"
    )


def rig_like(model: mujoco.MjModel, apart: bool) -> str:
    """The robot of the benchmark that is most like `model`, by what drives it and whether it touches anything.

    Args:
        apart: nothing touches along any run.
    """
    if not model.nu:
        return "block"
    if can_touch(model) and not apart:
        return "arm_contact" if model.actuator_trnid[0, 0] == 0 and not has_servos(model) else "leg"
    if has_servos(model):
        return "six_servo"
    return "six_axis" if model.nu >= AXES else "arm_free"


def _asked(diagnosis: Diagnosis) -> tuple[str, str, str] | None:
    """Columns that count what is like this answer and what was right of it, and the sentence; None: not counted."""
    if diagnosis.answer == NONE:
        return "visible", "found", "{good} of {count} effects were found that someone who knew them would have seen."
    if diagnosis.answer == UNNAMED:
        return None
    if len(diagnosis.answer_set) == 1:
        return "certain", "right", "{good} of {count} answers that left no choice were right in every name."
    return "choices", "held", "{good} of {count} answers that left a choice held the truth."
