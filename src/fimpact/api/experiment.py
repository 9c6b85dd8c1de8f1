"""The experiment that separates the names that a diagnosis could not tell apart, and what it says once it is played."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from fimpact import recordings
from fimpact.api.diagnosis import Diagnosis
from fimpact.api.pictures import drawn
from fimpact.cases.errors import CaseError
from fimpact.diagnosis.experiments import next_experiment, separating
from fimpact.diagnosis.experiments.resolve import Resolved
from fimpact.diagnosis.experiments.resolve import resolve as diagnose_anew
from fimpact.report.experiment_picture import commands as drawn_commands


@dataclass(frozen=True)
class Experiment:
    """Commands to play on the robot, and the state to start from.

    Attributes:
        diagnosis: whose names it separates.
        result: the design itself; its fields may change.
    """

    diagnosis: Diagnosis
    result: separating.Experiment

    @cached_property
    def _described(self) -> dict[str, Any]:
        return next_experiment.described(self.diagnosis.result, self.result)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self._described["seconds"])

    @cached_property
    def commands(self) -> pd.DataFrame:
        """A column for each actuator, in units of the MJCF, with the time in s as index; held between rows."""
        model = self.diagnosis.result.simulator.base
        index = pd.Index(np.arange(len(self.result.ctrl)) * self.result.period, name="time_s")
        return pd.DataFrame(self.result.ctrl, index, pd.Index([model.actuator(i).name for i in range(model.nu)]))

    @cached_property
    def start(self) -> pd.DataFrame:
        """The state to start from: quantity ("qpos" or "qvel"), of, value in units of the MJCF."""
        return next_experiment.start_table(self.diagnosis.result.simulator.base, self.result)

    @cached_property
    def pairs(self) -> pd.DataFrame:
        """Each two names: one, other, separation (non-centrality that is predicted for one run), repeats (runs that are
        needed for 80 % power at 1 %; none where nobody would play so many)."""
        return pd.DataFrame(self._described["pairs"], columns=["one", "other", "separation", "repeats"])

    def plot(self) -> Figure:
        """The commands over time."""
        return drawn(drawn_commands, self.diagnosis.result, self.result)

    def save(self, folder: str | Path) -> None:
        """Write experiment.csv and experiment-start.csv to a folder, which is made."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        next_experiment.write_experiment(self.diagnosis.result, self.result, Path(folder))


@dataclass(frozen=True)
class Resolution:
    """What is left of the names of a diagnosis when further runs are diagnosed with the others.

    Attributes:
        left: names that still cannot be told apart; one, if the experiment has decided.
        weights: of these, and with weight 0 of those that are gone, in falling order: name, weight.
    """

    left: tuple[str, ...]
    weights: pd.DataFrame

    def _repr_html_(self) -> str:
        return f"<p>Left: {', '.join(self.left)}</p>{self.weights.to_html(index=False, float_format='{:.0%}'.format)}"


def design_experiment(diagnosis: Diagnosis) -> Experiment | None:
    """Design the experiment, within the limits of what was recorded, that separates the names a diagnosis leaves.

    Returns:
        None where it leaves one name, or none.
    """
    found = next_experiment.next_experiment(diagnosis.result)
    return None if found is None else Experiment(diagnosis, found)


def resolve(
    diagnosis: Diagnosis, recording: recordings.Recording, *, progress: Callable[[str], None] | None = None
) -> Resolution:
    """Say which names of a diagnosis are left, once the experiment is recorded.

    Args:
        diagnosis: that left several names.
        recording: of the same robot; its runs of names that the diagnosis has not seen are diagnosed with the others.
        progress: receives one line at the start of each piece of work; None: silence.

    Raises:
        CaseError: no new run, a new run that is held out, or another model, period or channels.
    """
    known = diagnosis.result.recording
    added = _added(known, recording)
    if len(diagnosis.data["members"]) < 2:
        return _resolution([], [diagnosis.answer])
    before = [member.name for member in diagnosis.result.members]
    return _resolution(*diagnose_anew(known, added, before, progress or _silent))


def _added(known: recordings.Recording, recording: recordings.Recording) -> list[recordings.Run]:
    for what in ("period", "channels"):
        was, now = getattr(known, what), getattr(recording, what)
        if was != now:
            raise CaseError(f"{what}: the new recording has {now}, the diagnosis {was}; both must be the same")
    seen = {run.name for run in known.runs}
    added = [run for run in recording.runs if run.name not in seen]
    if not added:
        raise CaseError("the recording has no run that was not diagnosed; add that of the experiment under a new name")
    if any(run.held_out for run in added):
        raise CaseError("a new run is held out; resolving fits it: leave it out of held_out")
    return added


def _resolution(ranked: list[Resolved], left: list[str]) -> Resolution:
    weights = pd.DataFrame([[own.name, own.weight] for own in ranked], columns=["name", "weight"])
    return Resolution(tuple(left), weights)


def _silent(line: str) -> None:
    pass
