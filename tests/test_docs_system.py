"""The worked example of a system of one's own, docs/add-system.md, runs as printed."""

import os
import re
import shutil
import subprocess
import sys

from conftest import ROOT

SETTINGS = {
    "surface": 0.3,
    "timestep": 0.01,
    "steps": 60,
    "noise": 0.1,
    "inputs": {"force": 3.0, "knots": 4},
    "parameters": {"mass": {"unit": "kg", "nominal": 1.0, "bounds": [0.5, 2.0]}},
}

CHECK = """
import numpy as np
from fimpact.paper import reference_simulator
from fimpact.paper.forecast import forecaster
from fimpact.paper.information.programs import programs
from fimpact.paper.systems import make_system
cart = make_system("cart", {settings})
push = np.full(4, 3.0)
measured, steps = reference_simulator.simulate(cart, 1.2 * cart.nominal, push)
assert steps > 0
forecast = forecaster(cart).forecast(np.array([[1.2]]), push[None])
assert forecast.closest[0] < 0 < forecast.first[0]
for predicted in (forecast, programs(cart).linearise(cart.template, np.array([1.2]), push)):
    assert np.abs(predicted.measurement[0] * 0.1 - measured.ravel()).max() < 1e-6 * np.abs(measured).max()
"""


def test_the_printed_cart_runs_in_both_engines(tmp_path):
    shutil.copytree(ROOT / "src" / "fimpact", tmp_path / "fimpact")
    page, folder = (ROOT / "docs" / "add-system.md").read_text(), tmp_path / "fimpact" / "paper" / "systems"
    for language, name in (("xml", "cart.xml"), ("python", "cart.py")):
        (block,) = re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)
        (folder / name).write_text(block)
    registry = folder / "__init__.py"
    line = 'from fimpact.paper.systems.cart import cart\n\nSYSTEMS = {"cart": cart, '
    registry.write_text(registry.read_text().replace("SYSTEMS = {", line))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    code = CHECK.replace("{settings}", repr(SETTINGS))
    run = subprocess.run([sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
