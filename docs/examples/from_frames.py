"""Diagnose data frames: what a notebook does, as a script that a type checker accepts in strict mode."""

from pathlib import Path

import pandas as pd

import fimpact


def diagnosed(folder: Path) -> fimpact.Diagnosis:
    """Diagnose the two logs of the example in the folder."""
    frames = {day: pd.read_csv(folder / f"{day}.csv") for day in ("monday", "tuesday")}
    recording = fimpact.Recording.from_frames(
        folder / "arm.xml",
        frames,
        time=("time_s", "s"),
        commands={"drive": ("drive_Nm", "N m")},
        measurements={"shoulder": ("shoulder_rad", "rad")},
        unknowns=[{"field": "mass", "site": "arm", "sd": 0.2}, {"field": "damping", "site": "shoulder", "sd": 0.5}],
        held_out=["tuesday"],
        window=0.5,
    )
    return fimpact.diagnose(recording, progress=print)


def main() -> None:
    """Diagnose, print what was found, and write the page."""
    found = diagnosed(Path())
    print(found.verdict)
    strengths: pd.Series[float] = found.effects["value"]
    print(found.effects[["effect", "site", "unit"]].assign(value=strengths.round(4)).to_string(index=False))
    experiment = fimpact.design_experiment(found)
    if experiment is not None:
        print(experiment.pairs)
    print(found.save("page"))


if __name__ == "__main__":
    main()
