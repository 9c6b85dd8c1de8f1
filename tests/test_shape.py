"""The shape of a force without a name, from points as they come."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.mismatch.shape import shapes


def found(speed, force, deviation):
    """The shapes of one joint's force against its speed, (w, b) each."""
    time = np.tile(np.arange(speed.shape[1]), (len(speed), 1)) * 1.0
    parts = {"dofs": ("hinge",), "time": time, "qpos": np.zeros((*speed.shape, 2)), "qvel": speed[..., None]}
    parts |= {"force": force[..., None], "deviation": deviation[..., None]}
    return {shape.regressor: shape for shape in shapes(SimpleNamespace(**parts))}


def test_points_that_nearly_coincide_or_that_nobody_knows_break_no_curve():
    rng = np.random.default_rng(0)
    speed = np.repeat(np.linspace(-1, 1, 20), 20).reshape(50, 8) + 1e-12 * rng.standard_normal((50, 8))
    deviation = np.where(rng.random((50, 8)) < 0.3, 1e9, 0.1)
    force = 2 * speed + deviation * rng.standard_normal((50, 8))
    shape = found(speed, force, deviation)["speed"]
    assert shape.explained > 0.9
    assert shape.curve[[0, -1]] == pytest.approx([-2, 2], abs=0.2)


def test_what_several_windows_show_at_one_instant_counts_together():
    rng = np.random.default_rng(1)
    force = np.cos(np.arange(16) / 5) + rng.standard_normal((400, 16))
    shape = found(rng.standard_normal(force.shape), force, np.ones_like(force))["time"]
    assert len(shape.x) == 16
    assert shape.force == pytest.approx(np.cos(shape.x / 5), abs=0.2)
    assert shape.deviation == pytest.approx(np.full(16, 0.05))
