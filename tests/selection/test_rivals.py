"""Where something is late, all that may be is refitted; what is late by no more than any log explains nothing."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.selection.one_round import Round, Trial
from fimpact.selection.options import Option
from fimpact.selection.rivals import among_rivals

NAMES = ("sensor_delay@imu", "command_delay@motor", "actuator_lag@motor", "viscous@hinge")


def trial(member: int, p: float = 1.0) -> Trial:
    return Trial(
        Option(NAMES[member], 4, (member,)), None, p, 0.0, 0.0, 0.0, 0.0, (0, 0), np.zeros(3), (NAMES[member],)
    )


def placed(name: str, value: float) -> Placed:
    effect, site = name.split("@")
    (coefficient,) = EFFECTS[effect].neutral
    return Placed(EFFECTS[effect], site, {coefficient: value}, least={coefficient: 1e-4})


def asked(late: bool, losses: dict[str, float], sizes: dict[str, float], chosen: int = 0):
    """What is refitted beside what was chosen, and what is the likeliest, at these losses and sizes."""
    fits, names = {}, []
    for name, loss in losses.items():
        law = (placed(name, sizes.get(name, 1e-3)),)
        fits[name] = SimpleNamespace(
            placed=law, theta=np.zeros(0), numbers=[0], converged=True, loss=lambda spread, own=loss: own
        )

    def refitted(regression, own):
        names.append(own.option.name)
        return fits[own.option.name]

    track = SimpleNamespace(late=np.array([late]), model=SimpleNamespace(nu=1), steps=0)
    search = SimpleNamespace(track=track, refitted=refitted, progress=lambda line: None, alternatives=[])
    search.begun_with = lambda regression, own: ((), (), np.zeros(0))
    effects = [SimpleNamespace(effect=EFFECTS[name.split("@")[0]]) for name in NAMES]
    regression = SimpleNamespace(dispersion=1.0, columns=SimpleNamespace(candidates=effects))
    found = Round(trial(chosen, 1e-9), (), tuple(trial(i) for i in range(len(NAMES))))
    best = among_rivals(search, regression, found, fits[NAMES[chosen]])
    return set(names), best.placed[0].name


LOSSES = {"sensor_delay@imu": -100.0, "command_delay@motor": -150.0, "actuator_lag@motor": -120.0, "viscous@hinge": 0.0}
LATE = {"command_delay@motor", "actuator_lag@motor"}


@pytest.mark.parametrize("late", [True, False])
def test_where_sensors_feel_commands_jump_all_that_may_be_late_is_refitted(late):
    """However unlikely its tangent makes it."""
    names, first = asked(late, LOSSES, {})
    assert names == (LATE if late else set())
    assert first == ("command_delay@motor" if late else "sensor_delay@imu")


def test_what_is_not_late_asks_for_no_more():
    assert asked(True, LOSSES, {}, chosen=3) == (set(), "viscous@hinge")


def test_what_is_late_by_no_more_than_any_log_explains_nothing():
    assert asked(True, LOSSES, {"command_delay@motor": 1e-5})[1] == "actuator_lag@motor"
