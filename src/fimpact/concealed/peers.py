"""What others would do with the same recordings, judged alike: held-out error with initial states fitted.

- `mujoco.sysid` (3.17) fits the naive model's parameters, from the model's own values and from the best of five draws.
  Its optimiser, parameters and bounds are used as they come; the residual is a function of our own, as it allows: every
  training window from the state that the measurements show at its start, divided by the noise. The toolbox fits no
  initial states, and its own rollout takes no model without actuators, which the thrown block is.
- Refitting every candidate of the catalogue to convergence and choosing by BIC, with no screening.
- The black-box residual of `fimpact.mismatch.blackbox`.
"""

import time
from collections.abc import Sequence
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from fimpact.concealed.archive import load_recording
from fimpact.concealed.rows import Report, each
from fimpact.effects import EFFECTS
from fimpact.mismatch.blackbox import black_box
from fimpact.mismatch.evidence import weigh_evidence
from fimpact.mismatch.explain import Explanation, explain, refit
from fimpact.mismatch.judge import Bench, base_fit, bench, settle, squares
from fimpact.mismatch.locate import locate
from fimpact.mismatch.problem import NOTHING, coordinates
from fimpact.mismatch.pulses import pulses
from fimpact.mismatch.scales import scales
from fimpact.mismatch.score import Candidate, proposals, screen
from fimpact.mismatch.simulate import Hypothesis
from fimpact.recordings import Recording

STARTS, ITERATIONS = 5, 30  # of mujoco.sysid
SPREAD, BOUND = 3.0, 8.0  # prior standard deviations within which starts are drawn, and beyond which no fit goes
DIVERGED = 1e3  # standard deviations, in place of what has no number


def compare_part(
    recordings: Path, chosen: Sequence[str], refitted: Sequence[str], report: Report
) -> list[dict[str, Any]]:
    """A row for each of the `chosen` cases in the folder `recordings`; every candidate is refitted in `refitted`.

    Raises:
        ValueError: mujoco.sysid is not installed.
    """
    if chosen and not find_spec("plotly"):  # what it needs beyond mujoco, whose module is always there
        raise ValueError("mujoco.sysid cannot be imported; install the comparators: pip install -e '.[peers]'")

    def work(case: str) -> dict[str, Any]:
        return compare(load_recording(recordings, case), PEERS if case in refitted else PEERS[:-1], report)

    return list(each(chosen, work, report))


def compare(recording: Recording, peers: Sequence[str], report: Report = lambda line: None) -> dict[str, Any]:
    """Held-out error and seconds of each of the `peers` on one recording."""
    made = bench(recording)
    simulator = made.training.simulator
    naive = explain(*base_fit(made, coordinates(simulator), Hypothesis(simulator.theta)))
    out = {}
    for name in peers:
        report(f"{name} of {len(made.training.windows.runs)} windows")
        since = time.perf_counter()
        out |= COMPARATORS[name](made, naive)
        out[f"{name}_seconds"] = time.perf_counter() - since
    return out


def held_out_error(made: Bench, naive: Explanation, other: Explanation) -> float:
    """Root mean square held-out error of `other`, in standard deviations of the noise."""
    return weigh_evidence(made, naive, other).after


def _judged(made: Bench, naive: Explanation, hypothesis: Hypothesis) -> float:
    judged = settle(made.held_out, hypothesis, naive.judged.point)
    return held_out_error(made, naive, explain(naive.fitted, judged))


def _sysid(made: Bench, naive: Explanation) -> dict[str, float]:
    rng = np.random.default_rng(0)
    free = coordinates(made.training.simulator)
    draws = rng.uniform(-SPREAD, SPREAD, (STARTS, len(free.mean)))
    draws[0] = 0.0
    found = [_fit_sysid(made, free.mean + free.scale * draw) for draw in draws]
    single = _judged(made, naive, Hypothesis(found[0][1]))
    best = min(found, key=lambda pair: pair[0])
    return {"heldout_sysid": single, "heldout_sysid_five": _judged(made, naive, Hypothesis(best[1]))}


def _fit_sysid(made: Bench, start: np.ndarray) -> tuple[float, np.ndarray]:
    """Sum of squares and values at the optimum of `mujoco.sysid` from `start`, (p,)."""
    from mujoco import sysid

    problem, free = made.training, coordinates(made.training.simulator)
    low, high = np.maximum(free.low, free.mean - BOUND * free.scale), free.mean + BOUND * free.scale
    table = sysid.ParameterDict()
    for unknown, *row in zip(problem.simulator.recording.unknowns, free.mean, low, high, strict=True):
        table.add(sysid.Parameter(unknown.name, *row))
    table.update_from_vector(np.clip(start, low, high))

    def residual(values, parameters):
        columns = [_error(problem, column) for column in np.atleast_2d(values.T)]
        return [np.stack(columns, 1) if values.ndim > 1 else columns[0]], None, None

    unheard = StringIO()  # its backend prints whatever `verbose` says
    found, _ = sysid.optimize(table, residual, verbose=False, max_iters=ITERATIONS, x_scale=free.scale, output=unheard)
    theta = found.as_vector()
    return float((_error(problem, theta) ** 2).sum()), theta


def _error(problem, theta: np.ndarray) -> np.ndarray:
    point = problem.evaluate(Hypothesis(np.ravel(theta)), *problem.starts, NOTHING)
    return np.nan_to_num(point.residual.ravel(), nan=DIVERGED, posinf=DIVERGED, neginf=-DIVERGED)


def _refit_all(made: Bench, naive: Explanation) -> dict[str, Any]:
    problem, point = made.training, naive.fitted.point
    tried = proposals(list(EFFECTS.values()), problem, scales(problem, point))
    since = time.perf_counter()
    screened = screen(problem, naive.fitted, tried)
    screening = time.perf_counter() - since
    best: dict[str, Candidate] = {}
    for candidate in sorted(screened, key=lambda c: -c.gain):
        best.setdefault(candidate.placed.name, candidate)
    refitted = [naive, *(refit(made, naive, c) for c in best.values())]
    chosen = min(refitted, key=lambda e: _criterion(made, e))
    return {
        "screening_seconds": screening,
        "refits": len(best),
        "screened": len(screened),
        "answer_refit_all": chosen.name,
        "heldout_refit_all": held_out_error(made, naive, chosen),
    }


def _criterion(made: Bench, explanation: Explanation) -> float:
    """BIC of the training windows."""
    samples = np.isfinite(made.training.windows.measured).sum()
    total = squares(explanation.fitted).sum()
    price = np.log(samples) * len(explanation.fitted.coordinates.scale)
    return float(total + price) if np.isfinite(explanation.deviance) else np.inf


def _blackbox(made: Bench, naive: Explanation) -> dict[str, float]:
    problem = made.training
    location = locate(problem, naive.fitted, pulses(problem, naive.fitted))
    placed = black_box(problem.simulator, problem.windows, location)
    hypothesis = Hypothesis(naive.fitted.point.hypothesis.theta, (placed,))
    linear = naive.judged.linear
    judged = settle(made.held_out, hypothesis, naive.judged.point, linear)
    return {"heldout_blackbox": held_out_error(made, naive, explain(naive.fitted, judged))}


COMPARATORS = {"sysid": _sysid, "blackbox": _blackbox, "refit_all": _refit_all}
PEERS = tuple(COMPARATORS)  # the slowest last
