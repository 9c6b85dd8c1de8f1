"""What others would do with the same recording: `mujoco.sysid`, and a black box on top of the fitted model.

`mujoco.sysid` (3.17) is used as it comes: its optimiser, parameters and bounds. The residual is a function of our own,
as it allows: every training window from the state that the measurements show at its start, divided by the noise, and
what is known of the parameters before, as our own fits have it. The toolbox fits no initial states, and its own rollout
takes no model without actuators.
"""

from importlib.util import find_spec
from io import StringIO

import numpy as np

from fimpact.benchmark.comparators.free_parameters import Knobs
from fimpact.benchmark.comparators.random_features import learn_force
from fimpact.diagnosis.held_out import QUICK
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.windows import Windows, cut
from fimpact.smoothing.prepare import Prepared
from fimpact.smoothing.smoother import Smoothed

ITERATIONS = 30  # of mujoco.sysid
DIVERGED = 1e3  # standard deviations, in place of what has no number


def require_sysid() -> None:
    """Refuse, before anything is computed, where the toolbox is missing.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    if not find_spec("plotly"):  # what it needs beyond mujoco, whose module is always there
        raise ValueError("mujoco.sysid cannot be imported; install the comparators: pip install 'fimpact[peers]'")


def fit_sysid(prepared: Prepared, knobs: Knobs, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
    """Sum of squares and values, (p,), at the optimum of `mujoco.sysid` over short windows of the training runs.

    Args:
        start: (p,); None: that of `knobs`.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    require_sysid()
    from mujoco import sysid

    windows = training_windows(prepared)
    table = sysid.ParameterDict()
    rows = zip(prepared.track.recording.unknowns, knobs.start, knobs.low, knobs.high, strict=True)
    for unknown, *row in rows:
        table.add(sysid.Parameter(unknown.name, *row))
    if not table:
        return float((_error(prepared, windows, knobs, knobs.start) ** 2).sum()), knobs.start
    table.update_from_vector(np.clip(knobs.start if start is None else start, knobs.low, knobs.high))

    def residual(values, parameters):
        columns = [_error(prepared, windows, knobs, column) for column in np.atleast_2d(values.T)]
        return [np.stack(columns, 1) if values.ndim > 1 else columns[0]], None, None

    unheard = StringIO()  # its backend prints whatever `verbose` says
    found, _ = sysid.optimize(table, residual, verbose=False, max_iters=ITERATIONS, x_scale=knobs.scale, output=unheard)
    theta = found.as_vector()
    return float((_error(prepared, windows, knobs, theta) ** 2).sum()), theta


def training_windows(prepared: Prepared) -> Windows:
    """Windows of the training runs as long as the case has them, else of a second."""
    recording = prepared.track.recording
    length = round((recording.window or QUICK) / recording.period)
    return cut(prepared.track.runs, max(length, 2), recording.windows)


def _error(prepared: Prepared, windows: Windows, knobs: Knobs, theta: np.ndarray) -> np.ndarray:
    track, theta = prepared.track, np.ravel(theta)
    begun = prepared.begun[track.bounds[windows.runs] + windows.first]
    predicted = track.simulator.predict(Hypothesis(theta), windows, begun.qpos, begun.qvel, begun.act)
    missed = (windows.measured - predicted)[np.isfinite(windows.measured)]
    scale = np.broadcast_to(prepared.noise, windows.measured.shape)[np.isfinite(windows.measured)]
    error = np.nan_to_num(missed / scale, nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)
    return np.append(np.clip(error, -DIVERGED, DIVERGED), (theta - knobs.mean) / knobs.sd)


def black_box(naive: Smoothed) -> Hypothesis:
    """The naive fit with a learned force on top: a smooth function of state and command for what the model lacks."""
    track, states = naive.track, naive.states
    inside = ~track.last  # nothing is missing after the last sample of a run
    inputs = np.concatenate([states.qpos, states.qvel, track.ctrl[:, 0]], 1)
    placed = learn_force(inputs[inside], naive.tau[inside], track.run_of[inside])
    return Hypothesis(naive.theta, (placed,))
