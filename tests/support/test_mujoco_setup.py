"""MuJoCo simulates, and does nothing else beside."""

import mujoco
import pytest

from fimpact.simulation import simulator  # noqa: F401  (it is what hushes)
from fimpact.support import mujoco_setup

XML = "<mujoco><worldbody><body><joint type='slide'/><geom size='0.1' mass='1'/></body></worldbody></mujoco>"


def test_the_profiler_is_off(capfd):
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    data.qvel[:] = float("nan")
    mujoco.mj_step(model, data)
    assert data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration == 0.0
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("library", ["", "no/such/library.so"])
def test_where_the_clock_is_not_found_it_is_left_alone(monkeypatch, library):
    monkeypatch.setattr(mujoco_setup, "library_path", lambda: library)
    mujoco_setup.hush()
