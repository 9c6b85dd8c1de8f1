"""Model: what was named becomes part of the simulation, as an MJCF that plain MuJoCo loads.

Fields that MuJoCo has are written into `improved.xml`; a law that it lacks goes to `improved.py` beside it.
"""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

from fimpact.mismatch.diagnose import Diagnosis
from fimpact.mismatch.evidence import residuals
from fimpact.mismatch.export import write_files
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.replayed import replayed

AGREES = 0.005  # relative difference of held-out error; finer numerics are written where the naive ones give more
NEAR = 2  # numerics that are tried from initial states of their own, which takes longer
RK4 = mujoco.mjtIntegrator.mjINT_RK4
NUMERICS = (
    (None, 0),
    (RK4, 0),
    (RK4, 1),
    (RK4, 2),
    (RK4, 3),
    (None, 3),
)  # integrator (None: own), halvings of the step


@dataclass(frozen=True)
class Exported:
    """The files written; the relative difference of held-out error between them, in plain MuJoCo, and our simulation,
    None where there are none, and then why, in one sentence."""

    files: list[Path]
    difference: float | None = None
    refusal: str = ""


def refusal(diagnosis: Diagnosis) -> str:
    """Why no model is to be exported, in one sentence; empty where one is."""
    evidence = diagnosis.evidence
    if not diagnosis.naming.best.placed:
        return "No model is exported: no effect was added."
    if not evidence.low > 0:
        return (
            f"No model is exported: held-out data do not improve beyond doubt ({evidence.improvement:.0%}, "
            f"95 % interval {evidence.low:.0%} to {evidence.high:.0%})."
        )
    return ""


def write_model(diagnosis: Diagnosis, folder: Path | str) -> Exported:
    """Write `improved.xml`, the files that it loads and, where a law has no native field, `improved.py`.

    Integrator and time step are the naive model's if the file alone then agrees with the improved simulation, whose
    step error was extrapolated away; else the first of `NUMERICS` that does, or comes nearest. Nothing is written
    where `refusal` says why, or where the nearest is no better than the naive model.
    """
    if why := refusal(diagnosis):
        return Exported([], refusal=why)
    nearest, error = _nearest(diagnosis)
    if why := _spoiled(diagnosis, error):
        return Exported([], refusal=why)
    Path(folder).mkdir(parents=True, exist_ok=True)
    return Exported(write_files(diagnosis, Path(folder), *nearest), _difference(diagnosis, error))


def _nearest(diagnosis: Diagnosis) -> tuple[tuple, float]:
    """The first of `NUMERICS` that agrees, and what it leaves, in standard deviations: from the initial states of the
    improved simulation or else, for those that come nearest so, from their own, as every model is judged."""
    with TemporaryDirectory() as tried:
        asked = NUMERICS
        for profiled in (False, True):
            off = {}
            for numerics in asked:
                write_files(diagnosis, Path(tried), *numerics)
                error = _left(diagnosis, Path(tried), profiled)
                off[numerics] = _difference(diagnosis, error), error
                if off[numerics][0] <= AGREES:
                    return numerics, error
            asked = sorted(off, key=off.get)[:NEAR]
    return asked[0], off[asked[0]][1]


def check_model(diagnosis: Diagnosis, folder: Path | str) -> float:
    """Relative difference of held-out error between the files in `folder`, in plain MuJoCo, and our simulation."""
    own = _difference(diagnosis, _left(diagnosis, Path(folder)))
    return own if own <= AGREES else _difference(diagnosis, _left(diagnosis, Path(folder), profiled=True))


def _left(diagnosis: Diagnosis, folder: Path, profiled: bool = False) -> float:
    """Root mean square of what `replayed` leaves, in standard deviations; infinite where the simulation diverges."""
    error = float(np.sqrt((replayed(diagnosis, folder, profiled)[:, _alike(diagnosis)] ** 2).mean()))
    return error if np.isfinite(error) else np.inf


def _ours(diagnosis: Diagnosis, judged: Fit) -> float:
    """Root mean square of what our simulation leaves of the held-out windows, in standard deviations."""
    return float(np.sqrt((residuals(diagnosis.bench, judged)[:, _alike(diagnosis)] ** 2).mean()))


def _alike(diagnosis: Diagnosis) -> slice:
    """Samples of held-out windows in which files whose simulation begins there read what ours does: of what came
    before, which late readings show, they know nothing."""
    problem, hypothesis = diagnosis.bench.held_out, diagnosis.naming.best.judged.point.hypothesis
    before, after = problem.simulator.late.reach(hypothesis, problem.windows)
    last = problem.windows.length - after
    return slice(before, last) if before < last else slice(None)


def _difference(diagnosis: Diagnosis, error: float) -> float:
    return abs(error / _ours(diagnosis, diagnosis.naming.best.judged) - 1)


def _spoiled(diagnosis: Diagnosis, error: float) -> str:
    """Why files that leave `error` are of no use, in one sentence; empty where they are."""
    naive = _ours(diagnosis, diagnosis.naming.naive.judged)
    if error < naive:
        return ""
    return (
        f"No model is exported: in plain MuJoCo it would leave {error:.3g} standard deviations of held-out runs, the "
        f"naive model {naive:.3g}: in some windows the motion depends on the time step, whatever that is."
    )
