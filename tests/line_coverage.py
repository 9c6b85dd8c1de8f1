"""Count the lines of the package that the tests run, in every worker, and print them by package: `COVERAGE=1 pytest`.

What tests start as processes of their own is not counted, nor what numba compiles.
"""

import json
from pathlib import Path

import slipcover

PACKAGE = Path(__file__).parents[1] / "src" / "fimpact"
COMPILED = "*/kalman.py"  # numba reads its bytecode, which must be as it was written
counter = slipcover.Slipcover(source=[str(PACKAGE)], omit=[COMPILED])
slipcover.ImportManager(counter, slipcover.FileMatcher([PACKAGE], [COMPILED])).__enter__()
told: list[dict] = []  # by workers that have ended


def pytest_sessionfinish(session):
    """Hand over what a worker counted."""
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["lines"] = json.dumps(counter.get_coverage())


def pytest_testnodedown(node, error):
    """Take what a worker counted."""
    if "lines" in getattr(node, "workeroutput", {}):
        told.append(json.loads(node.workeroutput["lines"]))


def pytest_terminal_summary(terminalreporter):
    """Print the share of lines that were run, by package."""
    run: dict[str, set[int]] = {}
    known: dict[str, set[int]] = {}
    for own in told or [counter.get_coverage()]:
        for name, lines in own["files"].items():
            run[name] = run.get(name, set()) | set(lines["executed_lines"])
            known[name] = known.get(name, set()) | set(lines["executed_lines"]) | set(lines["missing_lines"])
    totals: dict[str, list[int]] = {}
    for name in sorted(known):
        parts = Path(name).resolve().relative_to(PACKAGE).parts
        for key in (parts[0] if len(parts) > 1 else "(top)", "all"):
            both = totals.setdefault(key, [0, 0])
            both[0] += len(run[name])
            both[1] += len(known[name])
    terminalreporter.section("lines run")
    for key, (ran, every) in totals.items():
        if key != "all":
            terminalreporter.line(f"{key:<12} {ran / every:6.1%} of {every}")
    terminalreporter.line(f"{'all':<12} {totals['all'][0] / totals['all'][1]:6.1%} of {totals['all'][1]}")
