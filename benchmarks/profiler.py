"""What it saves to simulate without MuJoCo's profiler: a ratio of times, in one process.

python benchmarks/profiler.py MODEL.xml ...

Fifty motions of 400 steps under random commands, with the profiler and without, in turns. The quickest of each counts:
what else the computer does only ever adds to it.
"""

import argparse
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from fimpact.support.mujoco_setup import clock

MOTIONS, STEPS, TURNS = 50, 400, 40


def quickest(model: mujoco.MjModel) -> dict[int | None, float]:
    """Seconds of the processor for each address of the clock."""
    engine, data, asked = Rollout(nthread=0), [mujoco.MjData(model)], clock()
    rest = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS) - 1 - model.nq
    start = np.tile(np.concatenate([[0.0], model.qpos0, np.zeros(rest)]), (MOTIONS, 1))
    ctrl = np.random.default_rng(0).standard_normal((MOTIONS, STEPS, model.nu))
    own = asked.value
    found = dict.fromkeys((own, None), float("inf"))
    for _ in range(TURNS):
        for address in found:
            asked.value, begun = address, time.process_time()
            engine.rollout(model, data, start, ctrl)
            found[address] = min(found[address], time.process_time() - begun)
    asked.value = own
    return found


def main() -> None:
    """One line per model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("models", nargs="+", type=Path)
    for path in parser.parse_args().models:
        model = mujoco.MjModel.from_xml_path(str(path))
        asking, silent = quickest(model).values()
        print(f"{path.stem}: {silent / asking:.2f} of {1e6 * asking / MOTIONS / STEPS:.2f} us a step")


if __name__ == "__main__":
    main()
