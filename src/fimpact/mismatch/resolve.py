"""Resolve: what a further experiment says about the explanations that could not be told apart."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fimpact.effects import get_effect
from fimpact.effects.base import Placed
from fimpact.mismatch.explain import Explanation, explain, sizes_of
from fimpact.mismatch.fit import fit
from fimpact.mismatch.judge import Bench, base_fit, bench, settle
from fimpact.mismatch.problem import coordinates
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.simulate import Hypothesis
from fimpact.mismatch.weigh import weigh
from fimpact.recordings import Recording, Run


def resolve(recording: Recording, added: Sequence[Run], members: Sequence[dict[str, dict]]) -> list[Explanation]:
    """Members refitted to the recording with the runs `added` to its training runs, in falling order of weight.

    Args:
        members: each a mapping ``effect@site`` -> values, as `diagnosis.json` holds them.
    """
    longer = replace(recording, runs=(*recording.runs, *(replace(run, held_out=False) for run in added)))
    made = bench(longer)
    naive = base_fit(made, coordinates(made.training.simulator), Hypothesis(made.training.simulator.theta))
    found = pulses(made.training, naive[0]), pulses(made.held_out, naive[1])
    return weigh(made, *found, [_refitted(made, naive, member) for member in members])


def _refitted(made: Bench, naive, member: dict[str, dict]) -> Explanation:
    placed = tuple(Placed(get_effect(n.split("@")[0]), n.split("@", 1)[1], dict(v)) for n, v in member.items())
    problem, point = made.training, naive[0].point
    free = coordinates(problem.simulator, placed, tuple(map(sizes_of, placed)))
    start = problem.evaluate(Hypothesis(point.hypothesis.theta, placed), point.qpos, point.qvel, free)
    if not np.isfinite(start.cost):
        raise ValueError(f"{'+'.join(member)} at {member} cannot be simulated on the added runs")
    fitted = fit(problem, free, start)
    return explain(fitted, settle(made.held_out, fitted.point.hypothesis, naive[1].point))
