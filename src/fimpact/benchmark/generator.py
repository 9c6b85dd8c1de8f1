"""The side of the benchmark that knows: it plants and seals, and plays what the blind side asks for."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from fimpact.benchmark.drawing.draw_case import draw_case
from fimpact.benchmark.jsonl import Arrays, Report, each, runs_of
from fimpact.benchmark.plan import Case
from fimpact.benchmark.seal import robot, write_case
from fimpact.benchmark.truth import Truth
from fimpact.recordings import Recording

DRAWS, SAME, APART, FURTHER = 24, 2, 1_000_003, 97  # draws that find no fit: other seeds, then other effects as well


def conceal(cases: Sequence[Case], settings: dict, recordings: Path, sealed: Path, report: Report) -> list[dict]:
    """Plant, record and seal `cases`; the rows say when it was done, not what."""
    recordings.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    by_name = {case.name: case for case in cases}

    def work(name: str) -> dict[str, Any]:
        return {"sha256": write_case(name, *_draw(by_name[name], settings), recordings, sealed)}

    return list(each(by_name, work, report, strict=True))


def _draw(case: Case, settings: dict) -> tuple[Recording, Truth]:
    spans = {kind: tuple(pair) for kind, pair in settings["lambda"].items()}
    for attempt in range(DRAWS):
        try:
            index, seed = case.index + FURTHER * max(attempt - SAME + 1, 0), settings["seed"] + APART * attempt
            return draw_case(index, case.kind, seed, case.system, spans)
        except ValueError as error:
            reason = error
    raise reason


def reveal(sealed: Path, commands: Arrays, chosen: Collection[str], report: Report) -> Arrays:
    """What the sealed robots measure under `commands`, (case/way/ctrl, qpos, qvel) -> case/way/ctrl as logged and
    case/way/measured: of all twins
    and of the `chosen` cases. Which are played tells what is a twin, when all is diagnosed already."""
    out: Arrays = {}
    for place, run in runs_of(commands).items():
        case, _, way = place.partition("/")
        asked = robot(sealed, case)
        if asked.truth.kind == "twin" or case in chosen:
            report(f"{case}: {way} experiment")
            played = asked.play(run)
            out |= {f"{place}/ctrl": played.ctrl, f"{place}/measured": played.measured}
    return out
