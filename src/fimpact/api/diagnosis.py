"""The diagnosis of a recording, for a notebook or a script."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fimpact import recordings
from fimpact.api.options import chosen_family
from fimpact.api.pictures import drawn
from fimpact.diagnosis import pipeline
from fimpact.diagnosis.experiments.next_experiment import next_experiment
from fimpact.diagnosis.remainder import dof_name
from fimpact.effects.plugins import load_effects
from fimpact.report.contents import describe_inputs
from fimpact.report.figures import force, horizon, joints
from fimpact.report.page import write_report
from fimpact.selection.search_scope import Limits

COLUMNS = ["effect", "site", "tier", "parameter", "value", "low", "high", "unit", "why_not"]
FORCES = ["joint", "unit", "naive", "left", "applied"]


@dataclass(frozen=True)
class Diagnosis:
    """What was found: `verdict` says it in a few short sentences, and the tables have the numbers.

    Attributes:
        result: all that every stage found, for whoever needs more than is here; its fields may change.
    """

    result: pipeline.Diagnosis

    @property
    def verdict(self) -> str:
        """What is missing, as the page says it."""
        return self.result.verdict

    @property
    def answer(self) -> str:
        """Names of the missing effects, ``effect@site`` joined by +; "none", or "unnamed" where no name fits."""
        return self.result.answer

    @property
    def candidates(self) -> tuple[str, ...]:
        """The answer and all that the recordings cannot tell from it."""
        return tuple(self.result.answer_set)

    @cached_property
    def data(self) -> dict[str, Any]:
        """All of it in plain types."""
        return pipeline.to_json(self.result)

    @cached_property
    def effects(self) -> pd.DataFrame:
        """The missing effects, a row for each number: effect, site, tier ("certain", "possible", "small"), parameter,
        value, low and high (95 % interval), unit, why_not (why it is not certain)."""
        rows = [
            {**one, **number, "parameter": number.get("name")}
            for one in self.data["effects"]
            for number in one["coefficients"] or [{}]
        ]
        return pd.DataFrame(rows, columns=COLUMNS)

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """The unknowns of the case, a row each: name, of, unit, before (the model's own value), after, low, high."""
        return pd.DataFrame(self.data["parameters"], columns=["name", "of", "unit", "before", "after", "low", "high"])

    @cached_property
    def missing_force(self) -> pd.DataFrame:
        """Root mean square force, N or N m, that the naive model lacks at each joint, what is left once the answer is
        added, and what was applied."""
        return pd.DataFrame(self.data["missing_force"], columns=FORCES)

    @cached_property
    def held_out(self) -> pd.DataFrame:
        """Errors of each held-out run in forward simulation: naive, everything freed, improved; unit in `attrs`."""
        table = pd.DataFrame(self.data["held_out"]["runs"])
        table.attrs |= {"unit": self.data["held_out"]["unit"], "noise_floor": self.data["held_out"]["noise_floor"]}
        return table

    def missing_force_in(self, run: str, improved: bool = False) -> pd.DataFrame:
        """The force that the model lacks in every sample of a training run: a column for each joint, N or N m, with the
        time in s as index.

        Args:
            run: name of the run.
            improved: what is left of it once the answer is added.

        Raises:
            ValueError: no training run has that name.
        """
        fit = self.result.explanation.final if improved else self.result.explanation.naive
        track = fit.track
        names = [own.name for own in track.runs]
        if run not in names:
            raise ValueError(f"there is no training run {run!r}; allowed: {', '.join(names)}")
        rows = track.slices()[names.index(run)]
        joints = [dof_name(track.model, dof) for dof in range(fit.tau.shape[1])]
        index = pd.Index(np.asarray(track.time[rows]), name="time_s")
        return pd.DataFrame(fit.tau[rows], index, pd.Index(joints))

    def plot_held_out(self) -> Figure:
        """Held-out error of each model against the time that is predicted in one go.

        Raises:
            ValueError: no run was held out.
        """
        if not self.data["held_out"]["horizons"]:
            raise ValueError("no run was held out, so there is no held-out error; keep one back with held_out")
        return drawn(horizon, self.data["held_out"])

    def plot_missing_force(self) -> Figure:
        """The missing force against speed, at the joint that lacks most, and what the found effects make of it."""
        return drawn(force, self.data["picture"], bool(self.data["effects"]))

    def plot_joints(self) -> Figure:
        """Missing force of each joint before and after."""
        return drawn(joints, self.data["missing_force"], bool(self.data["effects"]))

    def save(self, folder: str | Path) -> Path:
        """Write the page and all that belongs to it, as `fimpact diagnose` does: report.html, diagnosis.json, the
        figures, the improved MJCF and, where names are left that the recordings cannot tell apart, the next experiment.

        Args:
            folder: is made, or replaced if it holds nothing but an earlier page.

        Returns:
            Path of the page.

        Raises:
            FileExistsError: the folder holds files that are no part of a page.
        """
        origin: Mapping[str, str] = getattr(self.result.recording, "origin", {})
        provenance = {**describe_inputs([]), "inputs": dict(origin)}
        experiment = next_experiment(self.result) if len(self.result.members) > 1 else None
        return write_report(self.result, folder, experiment, provenance=provenance)

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict!r})"

    def _repr_html_(self) -> str:
        table = self.effects.drop(columns="why_not").to_html(index=False, float_format="{:.4g}".format, na_rep="")
        return f"<p><b>{escape(self.verdict)}</b></p>{table if len(self.effects) else ''}"


def diagnose(
    recording: recordings.Recording,
    *,
    quick: bool = False,
    only: str = "",
    budget: float | None = None,
    effects: str | Path | None = None,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what the model lacks.

    Args:
        recording: of `read_case` or `Recording.from_frames`.
        quick: ask for kinds of physics at classes of places only, not at single places.
        only: ask for one family of effects, such as "friction".
        budget: seconds after which nothing more is asked; the verdict says what was not asked.
        effects: Python file that adds effects of your own to the catalogue of this process.
        progress: receives one line at the start of each piece of work, such as `print`; None: silence.

    Raises:
        ValueError: no family has that name, the budget is not above 0 s, or `effects` cannot be run.
    """
    if budget is not None and not 0 < budget < math.inf:
        raise ValueError(f"budget is {budget}; allowed: more than 0 s")
    if effects is not None:
        load_effects(effects)
    limits = Limits(quick, chosen_family(only), budget or math.inf, time.monotonic())
    return Diagnosis(pipeline.diagnose(recording, progress or _silent, limits=limits))


def _silent(line: str) -> None:
    pass
