"""Sizes at which effects are tried, of a rod that a servo turns, and of one that nothing turns."""

import mujoco
import numpy as np

from fimpact.effects import EFFECTS
from fimpact.mismatch.explain import naive_fit
from fimpact.mismatch.judge import bench
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import proposals, screen
from fimpact.recordings import Recording, Run

SERVO = '<actuator><position name="servo" joint="pivot" kp="60" kv="2"/></actuator>'
NOISE, PERIOD, SAMPLES, LIMIT = 2e-4, 0.01, 50, 0.7


def rod(actuator: str) -> str:
    return f"""<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody><body name="rod">
      <joint name="pivot" axis="0 1 0" damping="0.3" armature="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.015" mass="0.3" contype="0" conaffinity="0"/>
      </body></worldbody>
      {actuator}<sensor><jointpos name="angle" joint="pivot"/></sensor></mujoco>"""


def recorded(actuator: str) -> Recording:
    """Four runs from rest; the servo gives no more than `LIMIT`."""
    model, rng, runs = mujoco.MjModel.from_xml_string(rod(actuator)), np.random.default_rng(0), []
    if actuator:
        model.actuator_forcelimited[0], model.actuator_forcerange[0] = True, (-LIMIT, LIMIT)
    for k in range(4):
        data, read = mujoco.MjData(model), []
        told = 0.5 * np.sin(2 * np.pi * rng.uniform(0.5, 1) * PERIOD * np.arange(SAMPLES))[:, None]
        data.qvel[:] = 0 if actuator else 3
        for now in told[:, : model.nu]:
            read.append(data.qpos + NOISE * rng.standard_normal(1))
            data.ctrl[:] = now
            mujoco.mj_step(model, data, 2)
        runs.append(Run(f"{k}", told[:, : model.nu], np.array(read), k == 3))
    return Recording(
        rod(actuator), ".", PERIOD, ("angle",), tuple(runs), (), np.array([NOISE]), np.full(2, np.inf), 0.25
    )


def test_what_a_servo_gives_is_not_its_gain_times_its_command():
    made = bench(recorded(SERVO))
    fitted = naive_fit(made).fitted
    sizes = scales(made.training, fitted.point)
    assert 0.5 < sizes.summit[0] / LIMIT < 10 and 60 * np.abs(made.training.windows.ctrl).max() > 25
    found = screen(made.training, fitted, proposals([EFFECTS["saturation"]], made.training, sizes))
    assert found and max(candidate.z for candidate in found) > 10


def test_what_nothing_drives_has_sizes_too():
    made = bench(recorded(""))
    sizes = scales(made.training, naive_fit(made).fitted.point)
    assert sizes.drive.shape == sizes.summit.shape == (0,) and 0.3 < sizes.speed[0] < 3
