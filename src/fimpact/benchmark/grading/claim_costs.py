"""Lines of the claim about what is exported and how long it takes."""

import numpy as np
import pandas as pd

from fimpact.benchmark.grading.claim_lines import ClaimLine, number, percent, share, with_interval

CORES = 2  # on which the whole benchmark is timed
WHOLE = 600  # cases of the whole benchmark: of fewer, its time is extrapolated


def export_lines(cases: pd.DataFrame) -> list[ClaimLine]:
    """How far an exported MJCF is from our own simulation."""
    off = cases.exported.dropna()
    return [
        with_interval("exported MJCF against our simulation, 95th percentile", off, _most, percent, -1, 0.02, 0.005),
        with_interval("… median", off, np.median, percent),
        share("… within 2 %", off <= 0.02),
    ]


def _most(values, axis=None):
    return np.percentile(values, 95, axis=axis)


def time_lines(cases: pd.DataFrame) -> list[ClaimLine]:
    """How long screening, refitting, one case and the whole benchmark take."""
    six = cases[cases.system.str.startswith("six")]
    planar, seconds = cases[~cases.index.isin(six.index)], number(" s", 1)
    stage = cases.seconds_screening if "seconds_screening" in cases else np.nan * cases.seconds
    refits = cases.refit_all_seconds - cases.screening_seconds
    alone, times = refits / cases.screening_seconds, number(" ×", 0)
    spent = float(np.nansum(cases.filter(regex="^job_").to_numpy(float)))
    whole = spent / CORES / 60 * max(WHOLE / max(len(cases), 1), 1.0)
    what = f"whole benchmark, {WHOLE} cases, on 2 cores"
    return [
        with_interval("refitting all over screening all, time ratio, median", alone, np.median, times, 1, 20, 100),
        with_interval("… over all that is done before anything is refitted", refits / stage, np.median, times),
        with_interval("one planar case, all stages, median", planar.seconds, np.median, seconds, -1, 10, 5),
        with_interval("… 95th percentile", planar.seconds, _most, seconds),
        *(
            [with_interval("one case of six joints, median", six.seconds, np.median, seconds, -1, 45, 20)]
            if len(six)
            else []
        ),
        ClaimLine(what, whole, np.nan, np.nan, len(cases), -1, 60, 45, number(" min", 0)),
    ]
