"""Sealing: the truth goes into a folder of its own, its sha256 beside the recording when that is made."""

import json
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from fimpact.benchmark.archive import save_recording
from fimpact.benchmark.truth import Truth, as_json, from_json, run_on_robot
from fimpact.recordings import Recording, Run

SEAL, TRUTH = "seal.txt", "truth.json"


def write_case(case: str, recording: Recording, truth: Truth, recordings: Path, sealed: Path) -> str:
    """Write case `case` into the folder `recordings`, and what is hidden in it into the folder `sealed`.

    Returns:
        The sha256 of the sealed file, which ``seal.txt`` beside the recording holds too.

    Raises:
        FileExistsError: the case is there already.
    """
    save_recording(recordings, case, recording)
    content = json.dumps(as_json(truth), indent=1).encode()
    seal = sha256(content).hexdigest()
    (Path(sealed) / case).mkdir(parents=True)
    (Path(sealed) / case / TRUTH).write_bytes(content)
    (Path(recordings) / case / SEAL).write_text(f"{seal}\n", encoding="ascii")
    return seal


def open_seal(sealed: Path, recordings: Path, case: str) -> Truth:
    """What is hidden in case `case`.

    Raises:
        ValueError: the sealed file is missing, or is not the one whose hash lies beside the recording.
    """
    content, noted = _sealed(sealed, case), Path(recordings) / case / SEAL
    if not noted.is_file():
        raise ValueError(f"case {case} has no {noted}; make the case again")
    expected, got = noted.read_text(encoding="ascii").strip(), sha256(content).hexdigest()
    if got != expected:
        raise ValueError(
            f"the seal of case {case} is broken: {Path(sealed) / case / TRUTH} has sha256 {got[:12]}..., "
            f"{noted} says {expected[:12]}...; make the case again"
        )
    return from_json(json.loads(content))


def _sealed(sealed: Path, case: str) -> bytes:
    path = Path(sealed) / case / TRUTH
    if not path.is_file():
        raise ValueError(f"case {case} has no {path}; make the case again")
    return path.read_bytes()


@dataclass(frozen=True)
class Robot:
    """The robot of a case, which can be told to move without saying what is wrong with it."""

    truth: Truth

    def play(self, run: Run) -> Run:
        """What is logged and measured under the commands of `run` from its believed start, with fresh noise."""
        nothing = np.zeros(len(self.truth.start[0]))
        start = nothing if run.qpos is None else np.concatenate([run.qpos, run.qvel])
        (played,) = run_on_robot(self.truth, run.ctrl[None], start[None], (run.name,))
        return played


def robot(sealed: Path, case: str) -> Robot:
    """The robot of case `case`. Raises ValueError where nothing is sealed under that name."""
    return Robot(from_json(json.loads(_sealed(sealed, case))))
