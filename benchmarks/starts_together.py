"""What it saves to simulate windows together that begin from varied states: a ratio of times, in one process.

python benchmarks/starts_together.py CASE.yaml backlash@elbow quadratic_drag@lower --data FOLDER

For the model as it is and for each effect at its first probe, the sensitivities of all training windows to their
initial states, all at once and one direction after the other, in turns. The quickest of each counts: what else the
computer does only ever adds to it.
"""

import argparse
import time
from pathlib import Path

from fimpact.cases import read_case
from fimpact.effects import EFFECTS
from fimpact.effects.base import Placed
from fimpact.mismatch import problem
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.judge import bench
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.scales import scales
from fimpact.mismatch.simulate import Hypothesis

TURNS = 14


def quickest(training: Problem, hypothesis: Hypothesis) -> dict[int, float]:
    """Seconds of the processor for each number of windows that may be simulated together."""
    point = training.evaluate(hypothesis, *training.starts, NOTHING)
    base = training.predict(hypothesis, *training.starts)
    found = dict.fromkeys((1, problem.TOGETHER), float("inf"))
    for _ in range(TURNS):
        for together in found:
            problem.TOGETHER, begun = together, time.process_time()
            training.starts_at(point, base)
            found[together] = min(found[together], time.process_time() - begun)
    return found


def main() -> None:
    """One line per hypothesis."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", type=Path)
    parser.add_argument("effects", nargs="*")
    parser.add_argument("--data", type=Path)
    options = parser.parse_args()
    training = bench(read_case(options.case, options.data)).training
    simulator = training.simulator
    naive = Hypothesis(simulator.theta)
    sizes = scales(training, training.evaluate(naive, *training.starts, NOTHING))
    for name in ("", *options.effects):
        effect, site = EFFECTS.get(name.partition("@")[0]), name.partition("@")[2]
        if name and (not effect or site not in effect.sites(simulator.base, simulator.recording.channels)):
            parser.error(f"there is no {name} in this case")
        placed = (Placed(effect, site, effect.probes(sizes, simulator.base, site)[0]),) if effect else ()
        alone, together = quickest(training, Hypothesis(simulator.theta, placed)).values()
        print(f"{name or 'the model as it is'}: {together / alone:.2f} of {1e3 * alone:.0f} ms")


if __name__ == "__main__":
    main()
