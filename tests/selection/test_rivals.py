"""What is refitted beside what was chosen, or where nothing was, and what a refit decides.

Where something is late, all that may be is refitted; what is late by no more than any log explains nothing.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.selection import rivals
from fimpact.selection.one_round import Round, Trial
from fimpact.selection.options import Option
from fimpact.selection.rivals import among_rivals, exchanged, weighed
from fimpact.selection.substitutes import Exchange

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


def fit_of(names: str, loss: float, numbers: int = 1) -> SimpleNamespace:
    laws = tuple(placed(name, 1e-3) for name in names.split())
    return SimpleNamespace(placed=laws, theta=np.zeros(0), numbers=[0] * numbers, converged=True, loss=lambda *_: loss)


def hinted(monkeypatch, ahead: float, chances: dict[int, float]) -> tuple[bool, SimpleNamespace, list[str]]:
    """Whether a refit is kept that is so far `ahead`, where nothing was found by more than these chances."""
    monkeypatch.setattr(rivals, "pruned", lambda search, fit: fit)
    names, naive = [], fit_of("", 0.0)

    def refitted(regression, own):
        names.append(own.option.name)
        return fit_of(own.option.name, -ahead if own.option.name == NAMES[3] else 1.0)

    search = SimpleNamespace(current=naive, refitted=refitted, candidates=[0] * 50, hint=0.05, rounds=[], weak={"x"})
    search.track = SimpleNamespace(late=np.array([False]), steps=7)
    search.progress, search.alternatives = lambda line: None, []
    search.begun_with = lambda regression, own: ((), (), np.zeros(0))
    effects = [SimpleNamespace(effect=EFFECTS[name.split("@")[0]]) for name in NAMES]
    regression = SimpleNamespace(dispersion=1.0, columns=SimpleNamespace(candidates=effects))
    found = Round(None, (), tuple(trial(i, p) for i, p in chances.items()))
    return weighed(search, regression, found), search, names


@pytest.mark.parametrize(("ahead", "kept"), [(8.0, False), (9.0, True)])
def test_a_hint_is_kept_where_a_refit_is_likelier_beyond_chance_over_all_that_was_tried(monkeypatch, ahead, kept):
    """log(50 / 0.01) = 8.5: as rarely may anything be found where nothing is missing."""
    found, search, names = hinted(monkeypatch, ahead, {0: 0.3, 3: 0.05, 1: 1.0})
    assert names == [NAMES[3], NAMES[0]] and found == kept  # strongest first, and none that is no hint
    assert bool(search.current.placed) == kept and search.track.steps == 7
    assert (search.hint < 0.01) == kept and (search.weak == {"x"}) == kept


def test_where_nothing_hints_nothing_is_refitted(monkeypatch):
    assert hinted(monkeypatch, 9.0, {0: 1.0})[::2] == (False, [])


@pytest.mark.parametrize(
    ("before", "after", "sure", "ahead", "taken"),
    [
        ("viscous@hinge", "coulomb@hinge", False, 2.5, False),
        ("viscous@hinge", "coulomb@hinge", False, 3.5, True),  # what is in would not even be in the set
        ("viscous@hinge", "coulomb@hinge", True, 1.5, True),
        ("viscous@hinge torque_offset@motor", "coulomb@hinge", True, -2.0, True),  # log(20) for an effect less
        ("viscous@hinge torque_offset@motor", "coulomb@hinge", True, -4.5, False),
    ],
)
def test_an_exchange_is_what_its_refit_says(monkeypatch, before, after, sure, ahead, taken):
    current, fit = fit_of(before, 0.0, 2), fit_of(after, -ahead, 2)
    offered = [Option(f"option {i}", 1, (0,)) for i in range(20)]
    other = Exchange(tuple(range(len(current.placed))), Option(after, 1, (0,)), None, 1.0, sure, 0.0)
    monkeypatch.setattr(rivals, "exchanges", lambda *_: [other])
    search = SimpleNamespace(current=current, alternatives=[], coupled=False, parts=set(), progress=lambda line: None)
    search.limits, search.open = SimpleNamespace(quick=True), lambda sums: []
    search.is_second_gear = lambda *_: False
    search.refitted = lambda *_: fit
    regression = SimpleNamespace(dispersion=1.0, columns=SimpleNamespace(candidates=[]))
    assert exchanged(search, regression, offered) == taken
    assert search.current is (fit if taken else current)
