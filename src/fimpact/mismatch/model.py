"""Model: what was named becomes part of the simulation, as an MJCF that plain MuJoCo loads.

Fields that MuJoCo has are written into `improved.xml`; a law that it lacks goes to `improved.py` beside it.
"""

import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
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
from fimpact.mismatch.evidence import residuals
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.mjcf import carry_assets, exact, sharpen
from fimpact.recordings import FIELDS

XML, CALLBACK = "improved.xml", "improved.py"
PAST = 500  # rows before a window that a native lag or delay is given to remember
AGREES = 0.005  # relative difference of held-out error; finer numerics are written where the naive ones give more
RK4 = mujoco.mjtIntegrator.mjINT_RK4
NUMERICS = (
    (None, 0),
    (RK4, 0),
    (RK4, 1),
    (RK4, 2),
    (RK4, 3),
    (None, 3),
)  # integrator (None: own), halvings of the step
TOLD = ("force", "friction", "gear")  # laws that ask what the motors are told
LISTS = {
    "model": "EDITS",
    "force": "FORCES",
    "friction": "FRICTIONS",
    "gear": "GEARS",
    "command": "COMMANDS",
    "measurement": "MEASUREMENTS",
}


@dataclass(frozen=True)
class Exported:
    """The files written; the relative difference of held-out error between them, in plain MuJoCo, and our simulation,
    None where there are none, and then why, in one sentence."""

    files: list[Path]
    difference: float | None = None
    refusal: str = ""


def refusal(diagnosis: Diagnosis) -> str:
    """Why no model is to be exported, in one sentence; empty where one is."""
    evidence = diagnosis.evidence
    if not diagnosis.naming.best.placed:
        return "No model is exported: no effect was added."
    if not evidence.low > 0:
        return (
            f"No model is exported: held-out data do not improve beyond doubt ({evidence.improvement:.0%}, "
            f"95 % interval {evidence.low:.0%} to {evidence.high:.0%})."
        )
    return ""


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


def write_model(diagnosis: Diagnosis, folder: Path | str) -> Exported:
    """Write `improved.xml`, the files that it loads and, where a law has no native field, `improved.py`.

    Integrator and time step are the naive model's if the file alone then agrees with the improved simulation, whose
    step error was extrapolated away; else the first of `NUMERICS` that does, or comes nearest. Nothing is written where
    `refusal` says why, or where the nearest is no better than the naive model.
    """
    if why := refusal(diagnosis):
        return Exported([], refusal=why)
    errors = {}
    with TemporaryDirectory() as tried:
        for numerics in NUMERICS:
            _write(diagnosis, Path(tried), *numerics)
            errors[numerics] = _replayed(diagnosis, Path(tried))
            if _difference(diagnosis, errors[numerics]) <= AGREES:
                break
    nearest = min(errors, key=lambda numerics: _difference(diagnosis, errors[numerics]))
    if why := _spoiled(diagnosis, errors[nearest]):
        return Exported([], refusal=why)
    Path(folder).mkdir(parents=True, exist_ok=True)
    return Exported(_write(diagnosis, Path(folder), *nearest), _difference(diagnosis, errors[nearest]))


def check_model(diagnosis: Diagnosis, folder: Path | str) -> float:
    """Relative difference of held-out error between the files in `folder`, in plain MuJoCo, and our simulation."""
    return _difference(diagnosis, _replayed(diagnosis, Path(folder)))


def _replayed(diagnosis: Diagnosis, folder: Path) -> float:
    """Root mean square of what the files in `folder` leave of every held-out window, replayed from its fitted initial
    state, in standard deviations. Infinite where the file's simulation diverges."""
    problem, judged = diagnosis.bench.held_out, diagnosis.naming.best.judged.point
    windows, scene = problem.windows, _player(diagnosis, folder)
    model = scene.load(folder / XML)
    states = zip(windows.runs, windows.first, judged.qpos, judged.qvel, strict=True)
    rows = [scene.simulate(model, windows.ctrl[run], q, v, int(first), windows.length) for run, first, q, v in states]
    error = problem.whiten(windows.measured - np.array(rows)).reshape(windows.measured.shape)
    error = float(np.sqrt((error[:, _alike(diagnosis)] ** 2).mean()))
    return error if np.isfinite(error) else np.inf


def _ours(diagnosis: Diagnosis, judged: Fit) -> float:
    """Root mean square of what our simulation leaves of the held-out windows, in standard deviations."""
    return float(np.sqrt((residuals(diagnosis.bench, judged)[:, _alike(diagnosis)] ** 2).mean()))


def _alike(diagnosis: Diagnosis) -> slice:
    """Samples of held-out windows in which files whose simulation begins there read what ours does: of what came
    before, which late readings show, they know nothing."""
    problem, hypothesis = diagnosis.bench.held_out, diagnosis.naming.best.judged.point.hypothesis
    before, after = problem.simulator.reach(hypothesis, problem.windows)
    last = problem.windows.length - after
    return slice(before, last) if before < last else slice(None)


def _difference(diagnosis: Diagnosis, error: float) -> float:
    return abs(error / _ours(diagnosis, diagnosis.naming.best.judged) - 1)


def _spoiled(diagnosis: Diagnosis, error: float) -> str:
    """Why files that leave `error` are of no use, in one sentence; empty where they are."""
    naive = _ours(diagnosis, diagnosis.naming.naive.judged)
    if error < naive:
        return ""
    return (
        f"No model is exported: in plain MuJoCo it would leave {error:.3g} standard deviations of held-out runs, the "
        f"naive model {naive:.3g}: in some windows the motion depends on the time step, whatever that is."
    )


def _write(diagnosis: Diagnosis, folder: Path, integrator: int | None, halvings: int) -> list[Path]:
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


def _player(diagnosis: Diagnosis, folder: Path) -> ModuleType:
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
