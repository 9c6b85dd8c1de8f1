"""The benchmark as a challenge: cases for any tool, and its answers held against what was sealed.

A folder of the challenge holds ``recordings/CASE`` (``model.xml``, the naive MJCF; ``recording.npz``, plain arrays; the
hash of the seal), ``sealed/CASE`` (what is hidden, not to be looked into) and ``answers.csv`` to be filled in.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from fimpact.benchmark.archive import cases_in
from fimpact.benchmark.drawing.draw_case import KINDS
from fimpact.benchmark.generator import conceal
from fimpact.benchmark.grading.answers import ENTERED, NOTHING, grade, listed, names_of
from fimpact.benchmark.jsonl import Report, read_rows
from fimpact.benchmark.plan import plan
from fimpact.benchmark.rigs.registry import RIGS
from fimpact.benchmark.seal import open_seal

SHARES = {"single": 0.4, "null": 0.1, "double": 0.08, "outside": 0.12, "twin": 0.05, "crowd": 0.25}
Sizes = dict[str, float]
ANSWERS = "answers.csv"
ASKED = ["tool", "case", "answer", "heldout_after", "seconds"]
ABOUT = """\
Each folder in recordings/ is a case: a robot whose naive model is model.xml, and recording.npz with its runs.

recording.npz holds `about`, JSON text with period (s), channels (names of sensors in model.xml), unknowns (parameters
of which the model is not sure, with their relative sd, or in m), the length of windows (s) and the runs with what is
held out; `0/ctrl` and `0/measured` are the commands (T, nu) and readings (T, ny) of the first run, and so on;
`0/qpos`, `0/qvel` its believed start where one is. Nothing says what is missing.

Answer in answers.csv, one row a case: `answer` is `none`, `unnamed` (something is missing that has no name), or a list
`effect@place` separated by `;` (`fimpact effects` lists effects and kinds of place). heldout_after: root mean square
error of the improved model over held-out runs, in standard deviations of the noise; seconds: of work; both may stay
empty. Then `fimpact benchmark grade answers.csv` writes entered.csv. sealed/ is for the grader alone.
"""


def make(seed: int, out: Path, count: int, rigs: Sequence[str], report: Report) -> int:
    """Write a challenge of `count` cases to the new folder `out`; returns how many there are.

    Raises:
        ValueError: no such rig. FileExistsError: the folder is there already.
    """
    if unknown := [rig for rig in rigs if rig not in RIGS]:
        raise ValueError(f"no rig is called {unknown[0]!r}; there are {', '.join(RIGS)}")
    if count < 1:
        raise ValueError(f"a challenge of {count} cases is none; ask for at least 1")
    out.mkdir(parents=True)
    settings = {"seed": seed, "cases": _shared(count), "rigs": list(rigs), "lambda": {}}
    cases = plan(settings)
    conceal(cases, settings, out / "recordings", out / "sealed", report)
    blank = pd.DataFrame([{"tool": "", "case": case.name, "answer": NOTHING} for case in cases], columns=ASKED)
    blank.to_csv(out / ANSWERS, index=False)
    (out / "README.txt").write_text(ABOUT, encoding="utf-8")
    return len(cases)


def _shared(count: int) -> dict[str, int]:
    """Cases of each kind, by the largest remainders of their shares."""
    exact = {kind: count * SHARES[kind] for kind in KINDS}
    found = {kind: int(own) for kind, own in exact.items()}
    for kind in sorted(KINDS, key=lambda k: found[k] - exact[k])[: count - sum(found.values())]:
        found[kind] += 1
    return found


def grade_answers(answers: Path, folder: Path) -> pd.DataFrame:
    """The rows of `answers` with precision and recall, as `entered.csv` has them.

    Args:
        folder: of the challenge, with ``recordings`` and ``sealed``.

    Raises:
        ValueError: a column or the challenge is missing, a case is unknown or answered twice by a tool, or a seal
            is broken.
    """
    table = pd.read_csv(answers, dtype={"case": str, "answer": str, "tool": str}, keep_default_na=False)
    if missing := [name for name in ("case", "answer") if name not in table]:
        raise ValueError(f"{answers} has no column {missing[0]!r}; it needs {', '.join(ASKED)}")
    known = cases_in(folder / "recordings")
    if not known:
        raise ValueError(f"{folder} holds no challenge; name the folder that `fimpact benchmark make` wrote")
    table = table.reindex(columns=ASKED, fill_value="")
    for case in table.case:
        if case not in known:
            raise ValueError(f"{answers} answers case {case!r}; {folder} has {known[0]} to {known[-1]}")
    if (twice := table[table.duplicated(["tool", "case"])].case).size:
        raise ValueError(f"{answers} answers case {twice.iloc[0]!r} twice; leave one row of each tool and case")
    rows = [
        row | graded(row["answer"], row["case"], folder / "recordings", folder / "sealed")
        for row in table.to_dict("records")
    ]
    return pd.DataFrame(rows)[ENTERED]


def graded(answer: str, case: str, recordings: Path, sealed: Path, sizes: Sizes | None = None) -> dict[str, Any]:
    """Columns of `grade` for an answer about `case`, whose seal is opened."""
    answer = answer.strip() or NOTHING
    return {"answer": listed(answer)} | grade(open_seal(sealed, recordings, case), names_of(answer), sizes or {})


def grade_entered(entries: Path, recordings: Path, sealed: Path) -> list[dict[str, Any]]:
    """Rows of `entered.csv` for what `entered.enter_part` wrote; a tool that failed on a case answered nothing."""
    rows = [{"answer": NOTHING, "sizes": {}, "heldout_after": None} | row for row in read_rows(entries).values()]
    return [row | graded(row["answer"], row["of"], recordings, sealed, row["sizes"]) for row in rows]


def summary(entered: pd.DataFrame) -> list[str]:
    """A line for each tool: cases, mean precision and recall."""
    lines = []
    for tool, own in entered.groupby("tool", sort=True):
        shares = (f"{name} {own[name].astype(float).mean():.2f}" for name in ("precision", "recall"))
        lines.append(f"{str(tool) or 'a tool'}: {len(own)} cases, {', '.join(shares)}")
    return lines
