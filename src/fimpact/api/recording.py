"""Recordings: what was measured, and the model it is compared with, from a case or from data frames."""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fimpact import recordings
from fimpact.api.frames import Entry, Frames, as_entry, as_runs, as_time
from fimpact.cases.case import files_read, inputs, recording_of
from fimpact.cases.case import read_case as read_file
from fimpact.cases.case_file import load_mapping
from fimpact.cases.errors import CaseError
from fimpact.report.contents import describe_inputs


@dataclass(frozen=True)
class Recording(recordings.Recording):
    """Runs of one robot, in SI units on one uniform time base, and the MJCF model that they are compared with.

    Make one with `read_case` or `Recording.from_frames`.

    Attributes:
        xml: text of the MJCF model.
        period: time between samples, s.
        channels: names of what was measured, (ny,).
        runs: each with `name`, `ctrl` (T, nu), `measured` (T, ny) and `held_out`.
        unknowns: parameters of the model that are fitted.
        notes: lines about how the log was read.
        origin: sha256 of each file, or of each data frame, that it was read from.
    """

    origin: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def from_frames(
        cls,
        model: str | Path,
        frames: Frames,
        *,
        measurements: Mapping[str, Entry],
        commands: Mapping[str, Entry] | None = None,
        time: Entry | None = None,
        rate: float | None = None,
        held_out: Collection[str | int] | None = None,
        **case: Any,
    ) -> "Recording":
        """Make a recording from data frames; no file is needed but the MJCF.

        Args:
            model: path of the MJCF.
            frames: a run each, at least two, named or numbered from 0. A NaN is a sample that was not taken.
            measurements: by sensor or joint of the MJCF, the column and its unit, ``("shoulder_rad", "rad")``, or a
                table with the keys that a case allows, ``{"column": "enc", "unit": "counts", "counts_per_rev": 4096}``.
            commands: by actuator, in the same way.
            time: the column, or the index of that name, that holds the time, and its unit.
            rate: instead of `time`: samples per second.
            held_out: names, or numbers, of the runs that only judge; None: the last.
            case: other keys of a case, such as ``unknowns=[{"field": "mass", "site": "arm", "sd": 0.2}]`` or
                ``window=0.5``; `fimpact keys` lists them all.

        Raises:
            CaseError: anything wrong with the data or the model, in one line.
        """
        if (time is None) == (rate is None):
            raise CaseError("give either `time`, a column and its unit such as ('t', 's'), or `rate` in Hz")
        runs, tables = as_runs(frames, held_out, as_time(time))
        table = {
            "model": str(model),
            "runs": runs,
            "time": {"rate": rate} if rate is not None else as_time(time),
            "measurements": {name: as_entry(name, one) for name, one in measurements.items()},
            "commands": {name: as_entry(name, one) for name, one in (commands or {}).items()},
            **case,
        }
        loaded = load_mapping(table, Path.cwd())
        found = recording_of(loaded, Path(), tables)
        return _with_origin(found, _hashes(found))

    def frame(self, run: str | int = 0) -> pd.DataFrame:
        """The samples of a run, in SI units: a column for each channel and each command, the time in s as index.

        Raises:
            CaseError: there is no such run.
        """
        own = self._run(run)
        model = self.spec().compile()
        actuators = [model.actuator(i).name or f"actuator {i}" for i in range(model.nu)]
        index = pd.Index(np.arange(len(own.measured)) * self.period, name="time_s")
        measured = pd.DataFrame(own.measured, index, pd.Index(self.channels))
        commands = pd.DataFrame(own.ctrl, index, pd.Index([f"command of {name}" for name in actuators]))
        return pd.concat([measured, commands], axis=1)

    def _run(self, run: str | int) -> recordings.Run:
        names = [own.name for own in self.runs]
        at = names.index(run) if run in names else run if isinstance(run, int) else len(names)
        if not 0 <= at < len(names):
            raise CaseError(f"there is no run {run!r}; allowed: {', '.join(names)}")
        return self.runs[at]

    def __repr__(self) -> str:
        return f"Recording({self._summary()})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(run.name)}</td><td>{len(run.measured) * self.period:.4g} s</td>"
            f"<td>{'judges' if run.held_out else 'is fitted'}</td></tr>"
            for run in self.runs
        )
        notes = "".join(f"<p>note: {escape(note)}</p>" for note in self.notes)
        return (
            f"<p>{escape(self._summary())}</p><table><thead><tr><th>run</th><th>length</th><th></th></tr></thead>"
            f"<tbody>{rows}</tbody></table>{notes}"
        )

    def _summary(self) -> str:
        spans = [sum(len(run.measured) for run in runs) * self.period for runs in (self.training, self.held_out)]
        return (
            f"{len(self.training)} runs to fit, {spans[0]:.4g} s; {len(self.held_out)} held out, {spans[1]:.4g} s; "
            f"a sample every {self.period:.4g} s of {', '.join(self.channels)}"
        )


def read_case(case: str | Path | Mapping[str, Any], data: str | Path | None = None) -> Recording:
    """Read a case: convert units, put it on one time base, and judge it.

    Args:
        case: path of the YAML file, or the same keys as a dict; its relative paths count from the working folder.
        data: folder of the data files; None: the `data` of the case, or its own folder.

    Returns:
        The recording in SI units and radians, NaN where nothing was measured.

    Raises:
        CaseError: anything wrong, in one line: what, what was got, what is allowed, what to do.
    """
    if isinstance(case, Mapping):
        loaded = load_mapping(case, Path.cwd())
        root = Path(data if data is not None else loaded.get("data", Path.cwd()))
        found, files = recording_of(loaded, root), files_read(loaded, root)
    else:
        found, files = read_file(case, data), [Path(case), *inputs(case, data)]
    return _with_origin(found, describe_inputs(files)["inputs"])


def _with_origin(found: recordings.Recording, origin: Mapping[str, str]) -> Recording:
    own = {one.name: getattr(found, one.name) for one in fields(recordings.Recording)}
    return Recording(**own, origin=dict(origin))


def _hashes(found: recordings.Recording) -> dict[str, str]:
    """sha256 of the model and of each run, as they are used."""
    parts = {"model": [found.xml.encode()]}
    parts |= {f"run {run.name}": [run.ctrl.tobytes(), run.measured.tobytes()] for run in found.runs}
    return {name: hashlib.sha256(b"".join(own)).hexdigest() for name, own in parts.items()}
