"""Where gears that give are asked by refits, and how long."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded import ROD, record, waves

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.selection import soft_gears
from fimpact.selection.forward import Search
from fimpact.selection.soft_gears import fitted
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

SERVO = ROD.replace("<motor ", '<position kp="9" kv="0.2" ').replace('damping="0.02"', 'damping="0.1" armature="0.03"')
KNOWN = ("coulomb", "torque_offset", "backlash", "joint_elasticity")


def search(xml: str, named: tuple[str, ...]) -> Search:
    """A search on a rod that has answered the effects `named`."""
    made = prepare(record(xml, ("angle",), [waves(200, [0.5], i) for i in range(2)], 1e-3), refine=1)
    state = Search(made.track, made.begun, made.noise, [EFFECTS[name] for name in KNOWN], lambda line: None)
    own = [c for c in state.candidates if c.effect.name in named]
    placed = [c.placed([0.1 * sd for sd in c.sd]) for c in own]
    state.current = smooth(made.track, made.begun, made.noise, placed, [c.priors for c in own], state.naive, rounds=2)
    return state


@pytest.mark.parametrize(
    ("xml", "named", "asked"),
    [
        (SERVO, (), [("pivot", [])]),
        (SERVO, ("coulomb",), [("pivot", [0])]),
        (SERVO, ("backlash",), [("pivot", [0])]),
        (ROD, (), []),
        (ROD, ("coulomb",), []),
        (ROD, ("coulomb", "torque_offset"), [("pivot", [0, 1])]),
    ],
)
def test_gears_are_asked_where_no_column_tells_them(xml, named, asked):
    state = search(xml, named)
    assert list(soft_gears._asked(state)) == asked
    state.softened |= {(joint, frozenset(state.current.placed[i].name for i in out)) for joint, out in asked}
    assert list(soft_gears._asked(state)) == []


@pytest.mark.parametrize(
    ("name", "loss", "fits"), [("backlash", -20.0, 2), ("backlash", -5.0, 1), ("coulomb", -20.0, 1)]
)
def test_a_rotor_that_is_ahead_and_not_still_goes_on(monkeypatch, name, loss, fits):
    state, asked = search(SERVO, ()), []
    law = Placed(EFFECTS[name], "pivot", {"gap": 0.01} if name == "backlash" else {"friction": 0.1})

    def fit(*own, **more):
        asked.append(own)
        return SimpleNamespace(converged=False, loss=lambda: loss, placed=own[3])

    monkeypatch.setattr(soft_gears, "smooth", fit)
    fitted(state, [law], [{}], np.zeros(0), bar=-10.0)
    assert len(asked) == fits
