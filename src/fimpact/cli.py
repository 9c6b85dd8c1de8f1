"""The command `fimpact`: check a case, write a first one, diagnose one, fit what you name, resolve what is left, list
what can be found.

argparse, because it ends with exit code 2 on bad usage as everything here does on bad input, and needs no dependency.
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from fimpact.cases.errors import CaseError

BAD_INPUT = 2


class _Parser(argparse.ArgumentParser):
    def error(self, message: str):
        self.exit(BAD_INPUT, f"{self.prog}: {message}; see `{self.prog} --help`\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        0; 2 on bad input, with one line on standard error and nothing written; 130 if it was interrupted.
    """
    options = _parser().parse_args(arguments)
    try:
        return options.run(options) or 0
    except (CaseError, ValueError) as error:
        print(f"fimpact: {' '.join(str(error).split())}", file=sys.stderr)
    except BrokenPipeError:  # whoever read the list has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        what = error.strerror or " ".join(str(error).split()) or type(error).__name__
        print(f"fimpact: {where}{what}", file=sys.stderr)
    except KeyboardInterrupt:
        print("fimpact: interrupted; nothing was written", file=sys.stderr)
        return 130
    return BAD_INPUT


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="fimpact", description="Say where a simulation and a recording part, and what is missing.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    data = {"type": Path, "metavar": "ROOT", "help": "folder of the data files, instead of the one the case names"}
    check = commands.add_parser("check", help="read and judge a case without running it")
    check.add_argument("case", type=Path, metavar="CASE.yaml")
    check.add_argument("--data", **data)
    check.set_defaults(run=_check)
    first = commands.add_parser("init", help="write a first case by matching column names to an MJCF")
    first.add_argument("model", type=Path, metavar="MODEL.xml")
    first.add_argument("log", type=Path, metavar="LOG")
    first.add_argument("-o", "--out", type=Path, metavar="CASE.yaml", default=Path("case.yaml"))
    first.set_defaults(run=_init)
    diagnose = commands.add_parser("diagnose", help="find what the model lacks, and write the page")
    diagnose.add_argument("case", type=Path, metavar="CASE.yaml")
    diagnose.add_argument("--data", **data)
    diagnose.add_argument("--out", type=Path, metavar="DIR", help="default: results/recordings/CASE")
    diagnose.add_argument("--effects", type=Path, metavar="FILE.py", help="adds effects of your own to the catalogue")
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
    catalogue = commands.add_parser("effects", help="list the physics that a model may be found to lack")
    catalogue.set_defaults(run=_effects)
    return parser


def _check(options: argparse.Namespace) -> None:
    from fimpact.cases import read_case

    recording = read_case(options.case, options.data)
    both = (recording.training, recording.held_out)
    spans = [f"{len(runs)} runs, {sum(len(r.measured) for r in runs) * recording.period:.4g} s" for runs in both]
    print(f"{options.case}: good. To fit: {spans[0]}; held out: {spans[1]}")
    print(f"every {recording.period:.6g} s: {', '.join(recording.channels)}")
    print(f"unknown: {', '.join(one.name for one in recording.unknowns) or 'nothing but the initial states'}")
    print("".join(f"note: {note}\n" for note in recording.notes), end="")


def _init(options: argparse.Namespace) -> None:
    from fimpact.cases.first import first_case

    if options.out.exists():
        raise CaseError(f"{options.out} exists; nothing is overwritten; choose another name with -o, or remove it")
    _check_place(options.out)
    first = first_case(options.model, options.log, options.out)
    options.out.write_text(first.text(), encoding="utf-8")
    print(f"wrote {options.out}; open:")
    print("\n".join(f"  {line}" for line in first.open))
    print(f"then: fimpact check {options.out}")


def _check_place(out: Path) -> None:
    """Before the work: a file can be written there."""
    if out.is_dir():
        raise CaseError(f"{out} is a folder; name a file with -o")
    if not out.resolve().parent.is_dir():
        raise CaseError(f"{out.resolve().parent} is not a folder; make it, or choose another name with -o")


def _diagnose(options: argparse.Namespace) -> None:
    from fimpact.diagnose_recording import diagnose_recording

    found, page = diagnose_recording(*_asked(options))
    print(f"page: {page}")
    print(found.verdict)


def _fit(options: argparse.Namespace) -> None:
    from fimpact.fit_recording import as_json, fit_recording, in_lines
    from fimpact.tables import write_text

    if options.out:
        _check_place(options.out)
    found = fit_recording(options.case, options.data, options.names, _tell, options.effects)
    if options.out:
        write_text(as_json(found), options.out)
    print("\n".join(in_lines(found)))


def _resolve(options: argparse.Namespace) -> None:
    from fimpact.effects.base import words
    from fimpact.resolve_recording import resolve_recording

    ranked, left = resolve_recording(*_asked(options))
    for member in ranked:
        print(f"{member.weight:4.0%}  {words(member.name)}")
    said = ", ".join(map(words, left))
    print(f"Left: {said}." if len(left) == 1 else f"These cannot be told apart yet: {said}.")


def _asked(options: argparse.Namespace) -> tuple:
    """Case, data, folder of the page, progress and effects, as the command line gives them."""
    out = options.out or Path("results") / "recordings" / options.case.stem
    return options.case, options.data, out, _tell, options.effects


def _tell(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _effects(options: argparse.Namespace) -> None:
    from fimpact.effects import EFFECTS

    width = max(map(len, EFFECTS))
    for family in dict.fromkeys(effect.family for effect in EFFECTS.values()):
        print(family)
        for effect in (e for e in EFFECTS.values() if e.family == family):
            print(f"  {effect.name:{width}}  {effect.sentence}")


if __name__ == "__main__":
    sys.exit(main())
