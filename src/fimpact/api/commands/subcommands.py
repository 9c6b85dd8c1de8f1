"""The subcommands: what each prints and writes. What a subcommand needs is imported when it runs."""

import argparse
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path


def check_case(options: argparse.Namespace) -> None:
    """Read and judge a case, and say what its motions can show."""
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


def write_first_case(options: argparse.Namespace) -> None:
    """Draft a case from an MJCF and its logs, and say what is left open."""
    from fimpact.cases.drafting.first_case import draft_case
    from fimpact.support.atomic_files import write_text

    if options.out.exists():
        raise ValueError(f"{options.out} exists; nothing is overwritten; choose another name with -o, or remove it")
    _check_place(options.out)
    first = draft_case(options.model, options.log, options.out)
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


def diagnose_case(options: argparse.Namespace) -> None:
    """Diagnose a case, write its page and say the verdict."""
    from fimpact.api.commands.diagnose_recording import diagnose_recording
    from fimpact.api.options import chosen_family
    from fimpact.selection.search_scope import Limits

    only = chosen_family(options.only, "--only")
    limits = Limits(options.quick, only, options.budget or math.inf, time.monotonic())
    found, page = diagnose_recording(*_asked(options), limits)
    print(f"page: {page}")
    print(found.verdict)


def fit_effects(options: argparse.Namespace) -> None:
    """Fit the effects that are named, and no others."""
    from fimpact.api.commands.fit_recording import as_json, fit_recording, in_lines
    from fimpact.cases import inputs
    from fimpact.support.atomic_files import write_text

    if options.out:
        own = [path for path in (options.case, options.effects) if path]
        _check_place(options.out, own)
        _check_place(options.out, inputs(options.case, options.data))
    found = fit_recording(options.case, options.data, options.names, teller(), options.effects)
    if options.out:
        write_text(as_json(found), options.out)
    print("\n".join(in_lines(found)))


def resolve_names(options: argparse.Namespace) -> None:
    """Say which names are left once the experiment is recorded."""
    from fimpact.api.commands.resolve_recording import resolve_recording
    from fimpact.diagnosis.pipeline import NONE, UNNAMED
    from fimpact.effects.base import words

    others = {NONE: "nothing that is missing", UNNAMED: "something without a name"}
    ranked, left = resolve_recording(*_asked(options))
    for member in ranked:
        print(f"{member.weight:4.0%}  {others.get(member.name) or words(member.name)}")
    said = ", ".join(others.get(name) or words(name) for name in left)
    if not ranked:
        print(f"Left: {said}. The diagnosis left no other name, and nothing is to be resolved.")
    else:
        print(f"Left: {said}." if len(left) == 1 else f"These cannot be told apart yet: {said}.")


def _asked(options: argparse.Namespace) -> tuple[Path, Path | None, Path, Callable[[str], None], Path | None]:
    """Case, data, folder of the page, progress and effects, as the command line gives them."""
    out = options.out or Path("results") / "recordings" / options.case.stem
    return options.case, options.data, out, teller(), options.effects


def teller() -> Callable[[str], None]:
    """What prints progress on the console."""
    from fimpact.api.commands.console import Teller

    return Teller()


def print_keys(options: argparse.Namespace) -> None:
    """Explain every key of a case."""
    from importlib.resources import files

    print(files("fimpact.cases").joinpath("keys.md").read_text(encoding="utf-8").rstrip())


def list_effects(options: argparse.Namespace) -> None:
    """List the catalogue, or tell one effect in full."""
    from fimpact.effects import get_effect
    from fimpact.effects.listing import catalogue, described, place_lister
    from fimpact.effects.plugins import load_effects

    if options.effects:
        load_effects(options.effects)
    places = place_lister(options.model) if options.model else None
    print("\n".join(described(get_effect(options.name), places) if options.name else catalogue(places)))
