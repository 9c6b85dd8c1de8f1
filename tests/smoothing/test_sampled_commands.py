"""Commands that come late: where they jump within a sample, and what a servo that saturates makes of it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from test_long_samples import PERIOD, followed

from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.plant import plant_of
from fimpact.smoothing.dynamics.sampled_commands import Commands, sharp
from fimpact.smoothing.prepare import prepare

MODEL = mujoco.MjModel.from_xml_string("<mujoco><option timestep='0.005'/></mujoco>")


def delayed(*delays: float) -> list[Placed]:
    return [Placed(EFFECTS["command_delay"], f"m{i}", {"delay": delay}) for i, delay in enumerate(delays)]


def test_a_step_ends_where_a_late_command_jumps():
    (law,), jumps = sharp(delayed(0.027), 0.02, 8)
    assert [moment for moment, _ in jumps] == pytest.approx([0.35])
    assert law.values["delay"] == pytest.approx(0.02 + jumps[0][1] / 8 * 0.02)
    values = np.where(np.arange(8) < jumps[0][1], 1.0, 5.0)[None, :, None]
    legs = list(Commands(values, jumps).legs(MODEL, 0.02, 4))
    for (_, given), told in zip(legs, ([1.0, 1.0], [5.0, 5.0, 5.0]), strict=True):
        np.testing.assert_allclose(given.ravel(), told)
    assert [model.opt.timestep * given.shape[1] for model, given in legs] == pytest.approx([0.007, 0.013])


def test_commands_of_a_step_are_worked_out_once():
    values = np.arange(8.0).reshape(1, 8, 1)
    given = Commands(values, ((0.35, 3),))
    first, again = (list(given.legs(MODEL, 0.02, 4)) for _ in range(2))
    assert all(one[1] is other[1] for one, other in zip(first, again, strict=True))
    coarser = [commands.shape for _, commands in given.legs(MODEL, 0.02, 2)]
    assert coarser != [commands.shape for _, commands in first]  # of another coarsest step, others


@pytest.mark.parametrize("delays", [(0.0600001, 0.0600002, 0.06), (0.0799999, 0.0799998), (0.061, 0.061, 0.0615)])
def test_jumps_that_are_near_one_another_keep_their_order(delays):
    laws, jumps = sharp(delayed(*delays), 0.02, 160)
    begins = [begin for _, begin in jumps]
    assert begins == sorted(set(begins)) and all(0 < begin < 160 for begin in begins)
    late = [law.values["delay"] for law in laws]
    assert np.abs(np.array(late) - delays).max() < 0.02 * 3 / 160 + 1e-9
    assert np.array_equal(np.argsort(late, kind="stable"), np.argsort(delays, kind="stable"))


def test_commands_that_do_not_jump_within_a_sample_are_as_they_were():
    laws, jumps = sharp(delayed(0.06, 0.04), 0.02, 160)
    assert jumps == () and [law.values["delay"] for law in laws] == [0.06, 0.04]
    ((model, given),) = Commands(np.arange(8.0).reshape(1, 8, 1)).legs(MODEL, 0.02, 4)
    assert model is MODEL and given.ravel().tolist() == [0.5, 2.5, 4.5, 6.5]


def test_a_small_delay_does_to_a_servo_that_saturates_what_a_larger_one_does():
    own = prepare(followed(3), refine=2)
    still = np.zeros_like(own.begun.qvel)

    def after(delay: float) -> np.ndarray:
        law = replace(delayed(delay)[0], site="servo")
        plant = plant_of(own.track, [law], own.track.simulator.theta, own.begun, still, np.ones_like(still))
        return plant.plain.step(own.begun, still).after.qpos[:-1]

    small, large = ((after(3 * PERIOD + more) - after(3 * PERIOD)) / more for more in (5e-6, 1e-3))
    assert np.linalg.norm(small - large) < 0.2 * np.linalg.norm(large)
