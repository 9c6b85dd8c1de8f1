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
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

OTHERS = "\n## The rigs here\n"  # from here on the page on keys is about cases of the repository
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
    check.set_defaults(run=_check)
    first = commands.add_parser("init", help="write a first case by matching column names to an MJCF")
    first.add_argument("model", type=Path, metavar="MODEL.xml")
    first.add_argument("log", type=Path, nargs="+", metavar="LOG", help="the last of several is held out")
    first.add_argument("-o", "--out", type=Path, metavar="CASE.yaml", default=Path("case.yaml"))
    first.set_defaults(run=_init)
    diagnose = commands.add_parser("diagnose", help="find what the model lacks, and write the page")
    diagnose.add_argument("case", type=Path, metavar="CASE.yaml")
    diagnose.add_argument("--data", **data)
    diagnose.add_argument("--out", type=Path, metavar="DIR", help="default: results/recordings/CASE")
    diagnose.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    diagnose.add_argument("--quick", action="store_true", help="ask for kinds at classes of places only")
    diagnose.add_argument("--only", metavar="FAMILY", default="", help="ask for one family, such as friction")
    diagnose.add_argument("--budget", type=_seconds, metavar="SECONDS", help="ask nothing more once they are over")
    diagnose.set_defaults(run=_diagnose)
    fit = commands.add_parser("fit", help="fit the effects that you name, and no others")
    fit.add_argument("case", type=Path, metavar="CASE.yaml")
    fit.add_argument("names", nargs="+", metavar="EFFECT@SITE", help="such as coulomb@shoulder; `fimpact effects`")
    fit.add_argument("--data", **data)
    fit.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    fit.add_argument("-o", "--out", type=Path, metavar="FILE.json", help="write parameters and held-out errors there")
    fit.set_defaults(run=_fit)
    further = commands.add_parser("resolve", help="say which name is left, once the experiment is recorded")
    further.add_argument("case", type=Path, metavar="CASE.yaml", help="with the new log under runs:")
    further.add_argument("--data", **data)
    further.add_argument("--out", type=Path, metavar="DIR", help="of the diagnosis; default: results/recordings/CASE")
    further.add_argument("--effects", type=Path, metavar="FILE.py", help="the same as the diagnosis had")
    further.set_defaults(run=_resolve)
    keys = commands.add_parser("keys", help="explain every key of a case")
    keys.set_defaults(run=_keys)
    catalogue = commands.add_parser("effects", help="list the physics that a model may lack, or one piece in full")
    catalogue.add_argument("name", nargs="?", metavar="NAME", help="such as coulomb: its numbers, units and fields")
    catalogue.add_argument("--model", type=Path, metavar="MODEL.xml", help="name the places that this MJCF has for it")
    catalogue.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
    catalogue.set_defaults(run=_effects)
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


def _check(options: argparse.Namespace) -> None:
    from fimpact.cases import read_case
    from fimpact.diagnosis.identifiability.case_check import shown_by_motions

    recording = read_case(options.case, options.data)
    shown = shown_by_motions(recording)
    both = (recording.training, recording.held_out)
    spans = [f"{len(runs)} runs, {sum(len(r.measured) for r in runs) * recording.period:.4g} s" for runs in both]
    print(f"{options.case}: good. To fit: {spans[0]}; held out: {spans[1]}")
    print(f"every {recording.period:.6g} s: {', '.join(recording.channels)}")
    print(f"unknown: {', '.join(one.name for one in recording.unknowns) or 'nothing but the initial states'}")
    print("".join(f"note: {note}\n" for note in recording.notes), end="")
    print("\n".join(shown))


def _init(options: argparse.Namespace) -> None:
    from fimpact.cases.drafting.first_case import first_case
    from fimpact.support.atomic_files import write_text

    if options.out.exists():
        raise ValueError(f"{options.out} exists; nothing is overwritten; choose another name with -o, or remove it")
    _check_place(options.out)
    first = first_case(options.model, options.log, options.out)
    write_text(first.text(), options.out)
    print(f"wrote {options.out}; to fill in: {'' if first.open else 'nothing'}")
    print("".join(f"  {line}\n" for line in first.open) + "concluded, to be looked at:")
    print("\n".join(f"  {line}" for line in first.taken))
    print(f"then: fimpact check {options.out}")


def _check_place(out: Path, files: Iterable[Path] = ()) -> None:
    """Before the work: a file can be written there, and is none of `files`, which are read."""
    from fimpact.support.atomic_files import check_apart, draft_folder

    if out.exists() and not out.is_file():
        raise ValueError(f"{out} is {'a folder' if out.is_dir() else 'no ordinary file'}; name a file with -o")
    parent = out.resolve().parent
    if not parent.is_dir():
        raise ValueError(f"{parent} is not a folder; make it, or choose another name with -o")
    check_apart(out, files)
    try:
        with draft_folder(parent):
            pass
    except OSError as error:
        raise ValueError(f"{out} cannot be written ({error.strerror}); choose another name with -o") from None


def _diagnose(options: argparse.Namespace) -> None:
    from fimpact.api.commands.diagnose_recording import diagnose_recording
    from fimpact.api.options import chosen_family
    from fimpact.selection.search_scope import Limits

    only = chosen_family(options.only, "--only")
    limits = Limits(options.quick, only, options.budget or math.inf, time.monotonic())
    found, page = diagnose_recording(*_asked(options), limits)
    print(f"page: {page}")
    print(found.verdict)


def _fit(options: argparse.Namespace) -> None:
    from fimpact.api.commands.fit_recording import as_json, fit_recording, in_lines
    from fimpact.cases import inputs
    from fimpact.support.atomic_files import write_text

    if options.out:
        own = [path for path in (options.case, options.effects) if path]
        _check_place(options.out, own)
        _check_place(options.out, inputs(options.case, options.data))
    found = fit_recording(options.case, options.data, options.names, _teller(), options.effects)
    if options.out:
        write_text(as_json(found), options.out)
    print("\n".join(in_lines(found)))


def _resolve(options: argparse.Namespace) -> None:
    from fimpact.api.commands.resolve_recording import resolve_recording
    from fimpact.effects.base import words

    ranked, left = resolve_recording(*_asked(options))
    for member in ranked:
        print(f"{member.weight:4.0%}  {words(member.name)}")
    said = ", ".join(map(words, left))
    if not ranked:
        print(f"Left: {said}. The diagnosis left no other name, and nothing is to be resolved.")
    else:
        print(f"Left: {said}." if len(left) == 1 else f"These cannot be told apart yet: {said}.")


def _asked(
    options: argparse.Namespace,
) -> tuple[Path, Path | None, Path, Callable[[str], None], Path | None]:
    """Case, data, folder of the page, progress and effects, as the command line gives them."""
    out = options.out or Path("results") / "recordings" / options.case.stem
    return options.case, options.data, out, _teller(), options.effects


def _teller() -> Callable[[str], None]:
    from fimpact.api.commands.console import Teller

    return Teller()


def _keys(options: argparse.Namespace) -> None:
    from importlib.resources import files

    text = files("fimpact.cases").joinpath("keys.md").read_text(encoding="utf-8")
    print(text.partition(OTHERS)[0].rstrip())


def _make_challenge(options: argparse.Namespace) -> None:
    from fimpact.benchmark.challenge import make
    from fimpact.benchmark.rigs.registry import RIGS

    rigs = options.rigs.split(",") if options.rigs else list(RIGS)
    count = make(options.seed, options.out, options.cases, rigs, _teller())
    print(f"{count} cases in {options.out}: fill in answers.csv there, then `fimpact benchmark grade`")


def _grade(options: argparse.Namespace) -> None:
    from fimpact.benchmark.challenge import grade_answers, summary

    graded = grade_answers(options.answers, options.of or options.answers.parent)
    out = options.answers.with_name("entered.csv")
    graded.to_csv(out, index=False)
    print("\n".join([*summary(graded), f"wrote {out}"]))


def _effects(options: argparse.Namespace) -> None:
    from fimpact.effects import get_effect
    from fimpact.effects.listing import catalogue, described, place_lister
    from fimpact.effects.plugins import load_effects

    if options.effects:
        load_effects(options.effects)
    places = place_lister(options.model) if options.model else None
    print("\n".join(described(get_effect(options.name), places) if options.name else catalogue(places)))


if __name__ == "__main__":
    sys.exit(main())
