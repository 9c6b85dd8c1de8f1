"""Export: the files for plain MuJoCo: `improved.xml` and, for laws that have no field in it, `improved.py`."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import patch
from xml.etree import ElementTree

import mujoco
import numpy as np

from fimpact.effects import sites
from fimpact.effects.base import Placed
from fimpact.effects.native import exporting, settle
from fimpact.mismatch import player
from fimpact.mismatch.callback import Bundle, listed
from fimpact.mismatch.diagnose import Diagnosis, in_words
from fimpact.mismatch.mjcf import carry_assets, exact, sharpen
from fimpact.recordings import FIELDS

XML, CALLBACK = "improved.xml", "improved.py"
PAST = 500  # rows before a window that a native lag or delay is given to remember
TOLD = ("force", "friction", "gear")  # laws that ask what the motors are told
LISTS = {
    "model": "EDITS",
    "force": "FORCES",
    "friction": "FRICTIONS",
    "gear": "GEARS",
    "command": "COMMANDS",
    "measurement": "MEASUREMENTS",
}


def improved_model(diagnosis: Diagnosis, integrator: int | None = None, halvings: int = 0) -> mujoco.MjSpec:
    """The naive model with fitted unknowns and the native fields of the named effects.

    Args:
        integrator: None: the naive model's. halvings: of its time step.
    """
    recording, hypothesis = diagnosis.recording, diagnosis.naming.best.fitted.point.hypothesis
    spec = recording.spec()
    spec.option.timestep = diagnosis.bench.training.simulator.base.opt.timestep / 2**halvings
    spec.option.integrator = spec.option.integrator if integrator is None else integrator
    settle(spec)
    for unknown, value in zip(recording.unknowns, hypothesis.theta, strict=True):
        put = FIELDS[unknown.field][2][1]
        exporting(lambda model, site, value, put=put: put(model, site, value))(spec, unknown.site, value=value)
    for placed in _in_fields(diagnosis):
        placed.effect.export(spec, placed.site, **placed.values)
    return spec


def write_files(diagnosis: Diagnosis, folder: Path, integrator: int | None, halvings: int) -> list[Path]:
    """Write the improved model into `folder`, with the assets that it loads and what it cannot hold; returns the files.

    Args:
        integrator, halvings: of `improved_model`.
    """
    spec = improved_model(diagnosis, integrator, halvings)
    model = spec.compile()
    tree = ElementTree.fromstring(spec.to_xml())
    sharpen(tree, exact(diagnosis.recording.xml, model))
    assets = carry_assets(tree, Path(diagnosis.recording.folder), folder)
    ElementTree.indent(tree)
    text = f"<!-- {_summary(diagnosis).replace('--', '- -')} -->\n{ElementTree.tostring(tree, encoding='unicode')}\n"
    (folder / XML).write_text(text, encoding="utf-8")
    if not (laws := _without_field(diagnosis)):
        return [folder / XML, *assets]
    (folder / CALLBACK).write_text(_callback(diagnosis, laws), encoding="utf-8")
    return [folder / XML, folder / CALLBACK, *assets]


def _summary(diagnosis: Diagnosis) -> str:
    found = "; ".join(in_words(diagnosis.naming, diagnosis.recording, p) for p in diagnosis.naming.best.placed)
    evidence = diagnosis.evidence
    partly = f" {CALLBACK} holds the rest." if _without_field(diagnosis) else ""
    return (
        f"Improved by fimpact: {found}. Held-out error {evidence.before:.3g} -> {evidence.after:.3g} "
        f"standard deviations of noise.{partly}"
    )


def _in_fields(diagnosis: Diagnosis) -> list[Placed]:
    """Named effects that fields of MuJoCo hold. Those that edit the model come first, as they do in our simulation: a
    cable is tied to where the centre of mass then is."""
    placed = diagnosis.naming.best.fitted.point.hypothesis.placed
    told = any(p.effect.export is None and p.effect.enters in TOLD for p in placed)
    held = [p for p in placed if p.effect.export is not None and _holds(diagnosis, p, told)]
    return sorted(held, key=lambda p: p.effect.enters != "model")


def _holds(diagnosis: Diagnosis, placed: Placed, told: bool) -> bool:
    """Whether native fields do what the law does here; told: whether another law asks what the motors are told."""
    if placed.effect.enters == "command":
        return not told  # MuJoCo's own lag sits behind the commands that such a law would see
    model = diagnosis.bench.training.simulator.base
    return placed.effect.enters != "measurement" or sites.carried(model, placed.site)


def _without_field(diagnosis: Diagnosis) -> list[Placed]:
    held = _in_fields(diagnosis)
    return [p for p in diagnosis.naming.best.fitted.point.hypothesis.placed if p not in held]


def _callback(diagnosis: Diagnosis, placed: list[Placed]) -> str:
    constants = _constants(diagnosis)
    bundle = Bundle(dict.fromkeys([*LISTS.values(), *constants], ""))
    for enters, name in LISTS.items():
        constants[name] = listed(
            bundle, [(p.effect.law, p.site, p.values) for p in placed if p.effect.enters == enters]
        )
    for thing in (player.load, player.simulate):
        bundle.add(thing)
    values = "\n".join(f"{name} = {text}" for name, text in constants.items())
    return f'"""{_explained(diagnosis, placed)}"""\n\n{bundle.text()}\n\n{values}\n'


def _explained(diagnosis: Diagnosis, placed: list[Placed]) -> str:
    laws = [
        f"{in_words(diagnosis.naming, diagnosis.recording, p)}\n    {p.effect.equation}\n    {p.effect.sentence}"
        for p in placed
    ]
    use = f'model = load("{XML}")\n    measured = simulate(model, ctrl, qpos, qvel)'
    return (
        f"What {XML} cannot hold, for plain MuJoCo: needs numpy and mujoco only. Written by fimpact.\n\n"
        + "\n\n".join(laws).replace("\\", "/").replace('"""', "'''")
        + f"\n\n    {use}\n\nOr step by step: Stepper(model, data).step(ctrl).{_left_out(placed)}\n"
    )


def _left_out(placed: list[Placed]) -> str:
    """What of the laws a single step cannot know, because it needs the whole run."""
    said = {
        "command": "\nIt takes what reaches the motors: a row of commands(ctrl, substeps)[0] in each time step.",
        "measurement": "\nIt returns what sensors truly read: measurements(rows, ctrl) is what they report of a run.",
    }
    return "".join(text for enters, text in said.items() if any(p.effect.enters == enters for p in placed))


def _past(diagnosis: Diagnosis) -> int:
    return PAST if any(p.effect.enters == "command" for p in _in_fields(diagnosis)) else 0


def _constants(diagnosis: Diagnosis) -> dict[str, str]:
    simulator = diagnosis.bench.training.simulator
    base, recording = simulator.base, diagnosis.recording
    signal = simulator.commands.describe(np.zeros((1, 1)), np.ones((1, 1, base.nu)))
    values = {
        "PERIOD": float(recording.period),
        "PAST": _past(diagnosis),
        "CHANNELS": tuple(recording.channels),
        "ACTUATORS": signal.actuators,
        "JOINT_OF": signal.joint_of,
        "DRIVEN_BY": signal.driven_by,
        "GAINS": tuple(signal.force[0, 0].tolist()),
    }
    return {name: repr(value) for name, value in values.items()}


def player_of(diagnosis: Diagnosis, folder: Path) -> ModuleType:
    """The exported callback, or the player without laws, as a module of its own."""
    path = folder / CALLBACK if (folder / CALLBACK).exists() else Path(player.__file__)
    spec = importlib.util.spec_from_file_location("improved", path)
    module = importlib.util.module_from_spec(spec)
    # Its dataclasses look for their names there; and no cache is left among the results.
    with patch.dict(sys.modules, improved=module), patch.object(sys, "dont_write_bytecode", True):
        spec.loader.exec_module(module)
    module.PERIOD, module.CHANNELS = diagnosis.recording.period, diagnosis.recording.channels
    module.PAST = _past(diagnosis)
    return module
