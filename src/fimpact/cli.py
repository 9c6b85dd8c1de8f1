"""The command `fimpact`: check a case, write a first one, diagnose one, fit what you name, resolve what is left, list
what can be found, make and grade a challenge.

argparse, because it ends with exit code 2 on bad usage as everything here does on bad input, and needs no dependency.
"""

import argparse
import io
import math
import os
import signal
import sys
import threading
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fimpact.api.commands.subcommands import (
    check_case,
    diagnose_case,
    fit_effects,
    list_effects,
    print_keys,
    resolve_names,
    teller,
    write_first_case,
)

FAULT, BAD_INPUT, INTERRUPTED = 1, 2, 130
TRACEBACK = "FIMPACT_TRACEBACK"  # an environment variable, for whoever mends this program


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        self.exit(BAD_INPUT, f"{_shown(f'{self.prog}: {message}; see `{self.prog} --help`')}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        0; 2 on bad input and 1 at a fault of this program, with one line on standard error and nothing written; 130 if
        it was interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that lacks a letter gets its number
            stream.reconfigure(errors="backslashreplace")
    options = _parser().parse_args(arguments)
    os.environ.setdefault("MPLBACKEND", "Agg")  # pictures go to files
    try:
        with _ended_as_interrupted(), warnings.catch_warnings():
            warnings.simplefilter("default" if os.environ.get(TRACEBACK) else "ignore")  # of libraries, to programmers
            return options.run(options) or 0
    except BrokenPipeError:  # whoever read the list has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        print("fimpact: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except MemoryError:
        print("fimpact: the memory is not enough for this; use shorter runs, or a smaller model", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        known, line = _in_a_line(error)
        if os.environ.get(TRACEBACK):
            traceback.print_exc()
        print(_shown(f"fimpact: {line}"), file=sys.stderr)
        return BAD_INPUT if known else FAULT


@contextmanager
def _ended_as_interrupted() -> Iterator[None]:
    """What a batch system ends (SIGTERM) clears up as after Ctrl-C; only a main thread can be told so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _in_a_line(error: Exception) -> tuple[bool, str]:
    """Whether an error is one of the input, and what to print of it."""
    words = " ".join(str(error).split())
    if isinstance(error, ValueError):
        return True, words or type(error).__name__
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return True, where + (error.strerror or words or type(error).__name__)
    at = traceback.extract_tb(error.__traceback__)[-1]
    said = f"{type(error).__name__}: {words}" if words else type(error).__name__
    return False, (
        f"a fault of fimpact, not of yours: {said} ({Path(at.filename).name}, line {at.lineno}); "
        f"please report it with what {TRACEBACK}=1 in the environment prints"
    )


def _shown(message: str) -> str:
    from fimpact.cases.errors import printable

    return printable(message)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="fimpact", description="Say where a simulation and a recording part, and what is missing.")
    parser.add_argument("--version", action="version", version=f"fimpact {version('fimpact')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    data: dict[str, Any] = {
        "type": Path,
        "metavar": "ROOT",
        "help": "folder of the data files, instead of the one the case names",
    }
    check = commands.add_parser("check", help="read and judge a case without running it")
    check.add_argument("case", type=Path, metavar="CASE.yaml")
    check.add_argument("--data", **data)
    check.set_defaults(run=check_case)
    first = commands.add_parser("init", help="write a first case by matching column names to an MJCF")
    first.add_argument("model", type=Path, metavar="MODEL.xml")
    first.add_argument("log", type=Path, nargs="+", metavar="LOG", help="the last of several is held out")
    first.add_argument("-o", "--out", type=Path, metavar="CASE.yaml", default=Path("case.yaml"))
    first.set_defaults(run=write_first_case)
    diagnose = commands.add_parser("diagnose", help="find what the model lacks, and write the page")
    diagnose.add_argument("case", type=Path, metavar="CASE.yaml")
    diagnose.add_argument("--data", **data)
    diagnose.add_argument("--out", type=Path, metavar="DIR", help="default: results/recordings/CASE")
    diagnose.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    diagnose.add_argument("--quick", action="store_true", help="ask for kinds at classes of places only")
    diagnose.add_argument("--only", metavar="FAMILY", default="", help="ask for one family, such as friction")
    diagnose.add_argument("--budget", type=_seconds, metavar="SECONDS", help="ask nothing more once they are over")
    diagnose.set_defaults(run=diagnose_case)
    fit = commands.add_parser("fit", help="fit the effects that you name, and no others")
    fit.add_argument("case", type=Path, metavar="CASE.yaml")
    fit.add_argument("names", nargs="+", metavar="EFFECT@SITE", help="such as coulomb@shoulder; `fimpact effects`")
    fit.add_argument("--data", **data)
    fit.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    fit.add_argument("-o", "--out", type=Path, metavar="FILE.json", help="write parameters and held-out errors there")
    fit.set_defaults(run=fit_effects)
    further = commands.add_parser("resolve", help="say which name is left, once the experiment is recorded")
    further.add_argument("case", type=Path, metavar="CASE.yaml", help="with the new log under runs:")
    further.add_argument("--data", **data)
    further.add_argument("--out", type=Path, metavar="DIR", help="of the diagnosis; default: results/recordings/CASE")
    further.add_argument("--effects", type=Path, metavar="FILE.py", help="the same as the diagnosis had")
    further.set_defaults(run=resolve_names)
    keys = commands.add_parser("keys", help="explain every key of a case")
    keys.set_defaults(run=print_keys)
    catalogue = commands.add_parser("effects", help="list the physics that a model may lack, or one piece in full")
    catalogue.add_argument("name", nargs="?", metavar="NAME", help="such as coulomb: its numbers, units and fields")
    catalogue.add_argument("--model", type=Path, metavar="MODEL.xml", help="name the places that this MJCF has for it")
    catalogue.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    catalogue.set_defaults(run=list_effects)
    _add_benchmark(commands.add_parser("benchmark", help="make a challenge of concealed physics, or grade one"))
    return parser


def _add_benchmark(parser: argparse.ArgumentParser) -> None:
    """Both halves of the challenge, for this tool and others."""
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    make = commands.add_parser("make", help="plant, record and seal cases in a new folder")
    make.add_argument("--seed", type=int, required=True, metavar="N", help="of all that is drawn; not one published")
    make.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    make.add_argument("--cases", type=int, default=60, metavar="COUNT", help="default: 60")
    make.add_argument("--rigs", default="", metavar="RIG,...", help="default: all six")
    make.set_defaults(run=_make_challenge)
    grade = commands.add_parser("grade", help="open the seals and write entered.csv beside the answers")
    grade.add_argument("answers", type=Path, metavar="ANSWERS.csv")
    grade.add_argument("--of", type=Path, metavar="FOLDER", help="of the challenge; default: that of the answers")
    grade.set_defaults(run=_grade)


def _seconds(text: str) -> float:
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is no time; allowed: more than 0 s")
    return value


def _make_challenge(options: argparse.Namespace) -> None:
    from fimpact.benchmark.challenge import make
    from fimpact.benchmark.rigs.registry import RIGS

    rigs = options.rigs.split(",") if options.rigs else list(RIGS)
    count = make(options.seed, options.out, options.cases, rigs, teller())
    print(f"{count} cases in {options.out}: fill in answers.csv there, then `fimpact benchmark grade`")


def _grade(options: argparse.Namespace) -> None:
    from fimpact.benchmark.challenge import grade_answers, summary

    graded = grade_answers(options.answers, options.of or options.answers.parent)
    out = options.answers.with_name("entered.csv")
    graded.to_csv(out, index=False)
    print("\n".join([*summary(graded), f"wrote {out}"]))


if __name__ == "__main__":
    sys.exit(main())
