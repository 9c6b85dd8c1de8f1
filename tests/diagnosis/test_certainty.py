"""What every rig has is told as small: rows of a log are stamped to a part of a sample only."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded import arm, rod

from fimpact.diagnosis.wording.certainty import CERTAIN, SLIGHT, findings
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.smoothing.candidates import at
from fimpact.smoothing.columns import motion_scales
from fimpact.smoothing.prepare import prepare
from fimpact.smoothing.smoother import smooth

TIMED = {"sensor_delay": "delay", "command_delay": "delay", "actuator_lag": "time", "clock_drift": "rate"}


def told(name: str, value: float, least: float) -> str:
    """The tier of an effect of this size."""
    law = Placed(EFFECTS[name], "all", {TIMED[name]: value}, least={TIMED[name]: least})
    number = SimpleNamespace(place=0, name=TIMED[name], value=value, at_bound=False)
    fit = SimpleNamespace(placed=(law,), priors=({TIMED[name]: 1.0},), converged=True, numbers=(number,))
    row = {"name": TIMED[name], "unit": "s", "after": value, "low": 0.9 * value, "high": 1.1 * value}
    return findings(fit, frozenset(), [row])[0].tier


@pytest.mark.parametrize("name", TIMED)
def test_a_time_within_which_rows_are_stamped_is_small_and_a_longer_one_is_not(name):
    assert told(name, 2e-3, 3e-3) == SLIGHT
    assert told(name, 4e-3, 3e-3) == CERTAIN


@pytest.mark.parametrize("name", TIMED)
def test_rows_are_stamped_to_a_fiftieth_of_a_sample(name):
    made = prepare(arm())
    scales = motion_scales(smooth(made.track, made.begun, made.noise))
    shift = at(EFFECTS[name], "all", made.track.model, scales)[0].least[TIMED[name]]
    shift *= scales.duration if name == "clock_drift" else 1.0
    np.testing.assert_allclose(shift, 0.02 * scales.period)


def test_only_all_sensors_together_may_be_logged_early():
    made = prepare(arm())
    scales, model = motion_scales(smooth(made.track, made.begun, made.noise)), made.track.model
    found = {site: at(EFFECTS["sensor_delay"], site, model, scales)[0] for site in ("q1", "q2", "all")}
    assert found["all"].ranges["delay"][0] == -scales.period and found["q1"].ranges["delay"][0] == 0.0
    assert [found[site].positive for site in ("q1", "q2", "all")] == [(True,), (True,), (False,)]
    alone = prepare(rod())
    scales = motion_scales(smooth(alone.track, alone.begun, alone.noise))
    assert at(EFFECTS["sensor_delay"], "angle", alone.track.model, scales)[0].positive == (False,)
