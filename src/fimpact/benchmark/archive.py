"""Recordings on disk: what the blind side is given, a folder for each case, without anything that tells what is hidden.

``recording.npz`` holds the arrays and, as text, everything else; ``model.xml`` is the naive model; ``seal.txt`` is
written by `fimpact.benchmark.seal`. Nothing is pickled.
"""

import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fimpact.recordings import Recording, Run, Unknown

ARRAYS, MODEL = "recording.npz", "model.xml"
STAMP = (1980, 1, 1, 0, 0, 0)  # of every file in the archive: equal recordings are equal bytes
START = ("qpos", "qvel")


def cases_in(recordings: Path) -> list[str]:
    """Names of the cases in the folder `recordings`, sorted."""
    return sorted(path.parent.name for path in Path(recordings).glob(f"*/{ARRAYS}"))


def save_recording(recordings: Path, case: str, recording: Recording) -> None:
    """Write `recording` as case `case`; its meshes, if any, are not copied.

    Raises:
        FileExistsError: the case is there already.
    """
    folder = Path(recordings) / case
    folder.mkdir(parents=True)
    arrays = {
        "about": np.array(json.dumps(_about(recording))),
        "noise": recording.noise,
        "start_sd": recording.start_sd,
    }
    for i, run in enumerate(recording.runs):
        arrays |= {f"{i}/ctrl": run.ctrl, f"{i}/measured": run.measured}
        arrays |= {f"{i}/{name}": getattr(run, name) for name in START if getattr(run, name) is not None}
    (folder / ARRAYS).write_bytes(_packed(arrays))
    (folder / MODEL).write_text(recording.xml, encoding="utf-8")


def _about(recording: Recording) -> dict:
    return {
        "period": recording.period,
        "window": recording.window,
        "channels": recording.channels,
        "unknowns": [asdict(unknown) for unknown in recording.unknowns],
        "runs": [{"name": run.name, "held_out": run.held_out} for run in recording.runs],
    }


def _packed(arrays: dict[str, np.ndarray]) -> bytes:
    """An npz file without the time at which it was made."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            entry = io.BytesIO()
            np.lib.format.write_array(entry, np.asarray(array), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy", STAMP), entry.getvalue(), zipfile.ZIP_DEFLATED)
    return out.getvalue()


def load_recording(recordings: Path, case: str) -> Recording:
    """The recording of `case` in the folder `recordings`.

    Raises:
        ValueError: there is no such case, or its files are not what `save_recording` wrote.
    """
    folder = Path(recordings) / case
    if not (folder / ARRAYS).is_file():
        raise ValueError(f"no recording of case {case!r} in {recordings}; there are {', '.join(cases_in(recordings))}")
    try:
        with np.load(folder / ARRAYS, allow_pickle=False) as stored:
            return _unpacked(dict(stored), (folder / MODEL).read_text(encoding="utf-8"), folder)
    except (KeyError, TypeError, OSError, zipfile.BadZipFile, ValueError) as error:
        raise ValueError(f"{folder / ARRAYS} is damaged ({error}); make the case again") from error


def _unpacked(arrays: dict[str, np.ndarray], xml: str, folder: Path) -> Recording:
    about = json.loads(str(arrays["about"]))
    runs = tuple(_run(arrays, i, row) for i, row in enumerate(about["runs"]))
    return Recording(
        xml=xml,
        folder=str(folder),
        period=about["period"],
        channels=tuple(about["channels"]),
        runs=runs,
        unknowns=tuple(Unknown(**unknown) for unknown in about["unknowns"]),
        noise=arrays["noise"],
        start_sd=arrays["start_sd"],
        window=about["window"],
    )


def _run(arrays: dict[str, np.ndarray], i: int, row: dict) -> Run:
    qpos, qvel = (arrays.get(f"{i}/{name}") for name in START)
    return Run(row["name"], arrays[f"{i}/ctrl"], arrays[f"{i}/measured"], row["held_out"], qpos, qvel)
