"""Systems as configured, built once: no test compiles what another has compiled."""

import os
from pathlib import Path

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of each worker, before numpy is loaded: there is a worker for each core

if os.environ.get("COVERAGE"):  # before the package is imported
    from line_coverage import pytest_sessionfinish, pytest_terminal_summary, pytest_testnodedown  # noqa: F401

import numpy as np
import pytest
import yaml

from fimpact.paper.systems import SYSTEMS, make_system

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT.parent / "shared" / "recordings"  # as measured, where they are

# Designs that touch at the nominal parameters: a steady push of the first joint, and a slanted throw.
TOUCHING = {"arm": np.tile([1.5, 0.0, 0.0], 8), "block": np.array([0.3, 0.5, -3.0, 2.0])}
CLEAR = {"arm": np.zeros(24), "block": np.array([0.0, 0.0, 2.0, 0.0])}


def marked(page: Path, word: str) -> str:
    """What stands between the comments `word` and `/word` of a Markdown page."""
    return page.read_text(encoding="utf-8").partition(f"<!-- {word} -->\n")[2].partition(f"<!-- /{word} -->")[0]


@pytest.fixture(scope="session")
def config():
    """The configuration of the paper."""
    return yaml.safe_load((ROOT / "config" / "config.yaml").read_text())


@pytest.fixture(scope="session")
def systems(config):
    """Every system of the configuration by name."""
    return {name: make_system(name, config["systems"][name]) for name in SYSTEMS}


@pytest.fixture(params=list(SYSTEMS))
def system(request, systems):
    """Each system in turn."""
    return systems[request.param]
