"""What others would do with the same recording: `mujoco.sysid`, and a black box on top of the fitted model.

`mujoco.sysid` (3.17) is used as it comes: its optimiser, parameters and bounds. The residual is a function of our own,
as it allows: every training window from the state that the measurements show at its start, divided by the noise, and
what is known of the parameters before, as our own fits have it. The toolbox fits no initial states, and its own rollout
takes no model without actuators.
"""

from importlib.util import find_spec
from io import StringIO

import numpy as np

from fimpact.knobs import Knobs
from fimpact.mismatch.blackbox import black_box
from fimpact.mismatch.coordinates import NOTHING
from fimpact.mismatch.explain import Explanation
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.judge import Bench, settle
from fimpact.mismatch.locate import locate
from fimpact.mismatch.problem import Problem
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.simulate import Hypothesis

ITERATIONS = 30  # of mujoco.sysid
DIVERGED = 1e3  # standard deviations, in place of what has no number


def require_sysid() -> None:
    """Refuse, before anything is computed, where the toolbox is missing.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    if not find_spec("plotly"):  # what it needs beyond mujoco, whose module is always there
        raise ValueError("mujoco.sysid cannot be imported; install the comparators: pip install -e '.[peers]'")


def fit_sysid(problem: Problem, knobs: Knobs, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """Sum of squares and values, (p,), at the optimum of `mujoco.sysid`.

    Args:
        start: (p,); None: that of `knobs`.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    require_sysid()
    from mujoco import sysid

    table = sysid.ParameterDict()
    rows = zip(problem.simulator.recording.unknowns, knobs.start, knobs.low, knobs.high, strict=True)
    for unknown, *row in rows:
        table.add(sysid.Parameter(unknown.name, *row))
    if not table:
        return float((_error(problem, knobs, knobs.start) ** 2).sum()), knobs.start
    table.update_from_vector(np.clip(knobs.start if start is None else start, knobs.low, knobs.high))

    def residual(values, parameters):
        columns = [_error(problem, knobs, column) for column in np.atleast_2d(values.T)]
        return [np.stack(columns, 1) if values.ndim > 1 else columns[0]], None, None

    unheard = StringIO()  # its backend prints whatever `verbose` says
    found, _ = sysid.optimize(table, residual, verbose=False, max_iters=ITERATIONS, x_scale=knobs.scale, output=unheard)
    theta = found.as_vector()
    return float((_error(problem, knobs, theta) ** 2).sum()), theta


def _error(problem: Problem, knobs: Knobs, theta: np.ndarray) -> np.ndarray:
    point = problem.evaluate(Hypothesis(np.ravel(theta)), *problem.starts, NOTHING)
    error = np.nan_to_num(point.residual.ravel(), nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)
    return np.append(error, (np.ravel(theta) - knobs.mean) / knobs.sd)


def judge_black_box(made: Bench, naive: Explanation) -> Fit:
    """The fitted model with a learned force on top, settled on the held-out windows."""
    problem = made.training
    location = locate(problem, naive.fitted, pulses(problem, naive.fitted))
    placed = black_box(problem.simulator, problem.windows, location)
    hypothesis = Hypothesis(naive.fitted.point.hypothesis.theta, (placed,))
    return settle(made.held_out, hypothesis, naive.judged.point, naive.judged.linear)
