"""A case file read whole: the one entry point between a user's files and the diagnosis."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from fimpact.cases import initial_state as starts
from fimpact.cases import quaternions
from fimpact.cases.added_sensors import place_sensors
from fimpact.cases.case_file import bases, load
from fimpact.cases.channels import Channel, channels, commands
from fimpact.cases.consistency.checks import check_columns, check_recording, check_rows, check_sources, fewest
from fimpact.cases.errors import CaseError, listed
from fimpact.cases.models.compiling import compiled
from fimpact.cases.models.naive import Naive, model_files, read_model
from fimpact.cases.raw_runs import file_paths, sources
from fimpact.cases.readers.columns import Table
from fimpact.cases.readers.files import files_of
from fimpact.cases.runs import ResampledRun, contiguous_segments, filtered_noise, held_commands, resample
from fimpact.cases.units import factor
from fimpact.recordings import FIELDS, Recording, Run, Unknown


def read_case(path: str | Path, data_root: str | Path | None = None) -> Recording:
    """Read, convert, put on one time base and judge everything that a case names.

    Args:
        path: the case, a YAML file as `fimpact keys` explains it.
        data_root: folder of the data files; None: the `data` of the case, or the folder of the case.

    Returns:
        The recording: SI units and radians, one uniform time base, NaN where nothing was measured.

    Raises:
        CaseError: anything wrong, in one line: what, what was got, what is allowed, what to do.
    """
    path = Path(path)
    case = load(path)
    return recording_of(case, _root(case, path, data_root))


def recording_of(case: dict, root: Path, tables: Mapping[Path, Table] | None = None) -> Recording:
    """The recording of a case that was loaded.

    Args:
        root: folder of the data files. tables: of files that need not be read, by path.

    Raises:
        CaseError: anything wrong, in one line.
    """
    naive = read_model(Path(case["model"]))
    place_sensors(naive, case["measurements"])
    naive = replace(naive, model=compiled(naive.tree, naive.path))
    sampled, drives, seen = _sampled(case, naive, root, tables)
    check_columns(sampled, drives, seen, set(case.get("accept", [])))
    period = _period(case, naive, sampled)
    recording = _recording(case, naive, seen, drives, sampled, period)
    notes = check_recording(recording, naive.model, seen, set(case.get("accept", [])))
    return replace(recording, notes=(*recording.notes, *notes))


def inputs(path: str | Path, data_root: str | Path | None = None) -> list[Path]:
    """Files that a case reads besides itself: its bases, its MJCF and what that includes, its data; each once.

    Raises:
        CaseError: the case is not valid; whether the files exist is not looked at.
    """
    case = load(Path(path))
    return list(dict.fromkeys([*bases(Path(path)), *files_read(case, _root(case, Path(path), data_root))]))


def files_read(case: dict, root: Path) -> list[Path]:
    """Files that a loaded case reads: its MJCF and what that includes, its data; each once."""
    data = [file for run in case["runs"] for path in file_paths(run, root) for file in files_of(path)]
    return list(dict.fromkeys([*model_files(Path(case["model"])), *data]))


def _root(case: dict, path: Path, data_root: str | Path | None) -> Path:
    return Path(data_root) if data_root is not None else Path(case.get("data", path.parent))


def _sampled(case: dict, naive: Naive, root: Path, tables: Mapping[Path, Table] | None):
    time = case["time"]
    if ("rate" in time) == ("column" in time) or {"rate", "fraction"} <= set(time):
        raise CaseError(
            f"time has {' and '.join(sorted(time)) or 'nothing'}; allowed: column and unit, and a fraction where there "
            "is one, or rate (Hz)"
        )
    if "column" in time and "unit" not in time:
        raise CaseError("time.unit is missing; declare the unit of the time column, such as s, ms or ns")
    unit = factor(time.get("unit", "s"), "s", "time")
    drives, seen = commands(naive, case.get("commands", {})), channels(naive.model, case["measurements"])
    runs = sources(case, root, tables)
    check_sources(runs)
    sampled = [resample(run, time, case.get("nan", "error"), drives, seen, unit) for run in runs]
    check_rows(runs, [*(one.column for one in drives), *(column for one in seen for column in one.columns)])
    return sampled, drives, seen


def _period(case: dict, naive: Naive, sampled: list[ResampledRun]) -> float:
    """The period of the grid, s: as declared, or that of the fastest channel; a whole number of simulation steps."""
    fastest = float(np.median([run.period for run in sampled]))
    wanted = 1 / case["rate"] if "rate" in case else fastest
    if wanted < 0.9 * fastest:
        raise CaseError(
            f"rate is {case['rate']} Hz, but the samples come at {1 / fastest:.5g} Hz; allowed: up to that; lower it"
        )
    steps = _steps(wanted, naive.model)
    return steps * float(f"{wanted / steps:.6g}")


def _steps(period: float, model: mujoco.MjModel) -> int:
    return max(1, int(np.ceil(period / model.opt.timestep - 1e-3)))


def _recording(
    case: dict, naive: Naive, seen: list[Channel], drives, sampled: list[ResampledRun], period: float
) -> Recording:
    naive.tree.append(_option(period / _steps(period, naive.model)))
    names = tuple(name for channel in seen for name in channel.names)
    noise = np.array([channel.noise for channel in seen for _ in channel.columns])
    filtered = [filtered_noise(sampled, column, one, period) for column, one in enumerate(noise)]
    start = starts.checked(naive.model, case.get("start", {}), "start")
    window = float(case.get("window", 0.0))
    least = fewest(window, period)
    return Recording(
        xml=naive.text(),
        folder=str(naive.path.resolve().parent),
        period=period,
        channels=names,
        runs=tuple(run for one in sampled for run in _runs(one, naive.model, seen, drives, period, start, least)),
        unknowns=_unknowns(naive, case.get("unknowns", [])),
        noise=np.array(filtered),
        start_sd=starts.prior(naive.model, start),
        window=window,
        windows=case.get("windows", 0),
        notes=tuple(dict.fromkeys(note for one in sampled for note in one.notes)),
    )


def _option(timestep: float):
    from xml.etree import ElementTree

    return ElementTree.Element("option", {"timestep": f"{timestep!r}"})


def _runs(sampled: ResampledRun, model: mujoco.MjModel, seen, drives, period: float, start: dict, least: int):
    state = start | starts.checked(model, sampled.source.state, f"{sampled.source.where}.state")
    for name, opens, low, measured in contiguous_segments(sampled, period, least):
        measured = quaternions.unit(measured, seen, sampled.source.where)
        ctrl = held_commands(sampled, drives, low, period, len(measured))
        given = state if opens else {}
        measured = starts.as_model(model, seen, measured, period, given)
        qpos, qvel = starts.estimated_start(model, seen, measured, period, given)
        yield Run(name, ctrl, measured, sampled.source.held_out, qpos, qvel, opens)


def _unknowns(naive: Naive, table: list[dict]) -> tuple[Unknown, ...]:
    out = tuple(Unknown(one["field"], one["site"], float(one.get("sd", np.inf))) for one in table)
    for index, one in enumerate(out):
        where = f"unknowns[{index}]"
        if one.field not in FIELDS:
            raise CaseError(f"{where}.field '{one.field}' does not exist; {listed(FIELDS, one.field)}; correct it")
        try:
            value = FIELDS[one.field][2][0](naive.model, one.site)
        except (KeyError, IndexError, AttributeError) as error:
            raise CaseError(
                f"{where}: {one.field} has no site '{one.site}' ({_short(error)}); correct `site`"
            ) from None
        if one.field in ("mass", "inertia") and value <= 0:
            raise CaseError(f"{where}: '{one.site}' has no mass; allowed: bodies that have; correct `site`")
        if one.name in [other.name for other in out[:index]]:
            raise CaseError(f"{where}: {one.name} is there twice; remove one of them")
    return out


def _short(error: Exception) -> str:
    return str(error.args[0] if error.args else error).rstrip(".")
