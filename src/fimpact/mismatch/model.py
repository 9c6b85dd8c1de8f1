"""Model: what was named becomes part of the simulation, as an MJCF that plain MuJoCo loads.

Fields that MuJoCo has are written into `improved.xml`; a law that it lacks goes to `improved.py` beside it.
"""

import importlib.util
import re
import shutil
import sys
from pathlib import Path
from types import ModuleType
from unittest.mock import patch
from xml.etree import ElementTree

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.effects.native import exporting
from fimpact.mismatch import player
from fimpact.mismatch.callback import Bundle, listed
from fimpact.mismatch.diagnose import Diagnosis, in_words
from fimpact.recordings import FIELDS

XML, CALLBACK, ASSETS = "improved.xml", "improved.py", "assets"
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
LISTS = {
    "model": "EDITS",
    "force": "FORCES",
    "friction": "FRICTIONS",
    "gear": "GEARS",
    "command": "COMMANDS",
    "measurement": "MEASUREMENTS",
}
KEPT = ("body_", "dof_", "jnt_", "geom_", "site_", "actuator_", "pair_", "eq_", "tendon_", "qpos", "cam_", "mesh_")


def refusal(diagnosis: Diagnosis) -> str:
    """Why no model is exported, in one sentence; empty where one is."""
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
    for unknown, value in zip(recording.unknowns, hypothesis.theta, strict=True):
        put = FIELDS[unknown.field][2][1]
        exporting(lambda model, site, value, put=put: put(model, site, value))(spec, unknown.site, value=value)
    for placed in hypothesis.placed:
        if placed.effect.export is not None:
            placed.effect.export(spec, placed.site, **placed.values)
    return spec


def write_model(diagnosis: Diagnosis, folder: Path | str) -> list[Path]:
    """Write `improved.xml`, the files that it loads and, where a law has no native field, `improved.py`.

    Integrator and time step are the naive model's if the file alone then agrees with the improved simulation, whose
    step error was extrapolated away; else the first of `NUMERICS` that does, or comes nearest.

    Returns:
        Paths of what was written; none where `refusal` says why.
    """
    if refusal(diagnosis):
        return []
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    found = {}
    for numerics in NUMERICS:
        written = _write(diagnosis, folder, *numerics)
        found[numerics] = check_model(diagnosis, folder)
        if found[numerics] <= AGREES:
            return written
    return _write(diagnosis, folder, *min(found, key=found.get))


def check_model(diagnosis: Diagnosis, folder: Path | str) -> float:
    """Relative difference of held-out error between the files in `folder`, in plain MuJoCo, and our simulation.

    Every held-out window is replayed from its fitted initial state. Infinite where the file's simulation diverges.
    """
    problem, judged = diagnosis.bench.held_out, diagnosis.naming.best.judged.point
    windows, scene = problem.windows, _player(diagnosis, Path(folder))
    model = scene.load(Path(folder) / XML)
    states = zip(windows.runs, windows.first, judged.qpos, judged.qvel, strict=True)
    rows = [scene.simulate(model, windows.ctrl[run], q, v, int(first), windows.length) for run, first, q, v in states]
    theirs = problem.whiten(windows.measured - np.array(rows))
    ours = judged.residual[:, : theirs.shape[1]]
    difference = abs(np.sqrt((theirs**2).mean() / (ours**2).mean()) - 1)
    return float(difference) if np.isfinite(difference) else np.inf


def _write(diagnosis: Diagnosis, folder: Path, integrator: int | None, halvings: int) -> list[Path]:
    spec = improved_model(diagnosis, integrator, halvings)
    model = spec.compile()
    tree = ElementTree.fromstring(spec.to_xml())
    _sharpen(tree, _exact(diagnosis.recording.xml, model))
    assets = _carry_assets(tree, Path(diagnosis.recording.folder), folder)
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
    partly = "" if all(p.effect.export for p in diagnosis.naming.best.placed) else f" {CALLBACK} holds the rest."
    return (
        f"Improved by fimpact: {found}. Held-out error {evidence.before:.3g} -> {evidence.after:.3g} "
        f"standard deviations of noise.{partly}"
    )


def _exact(xml: str, model: mujoco.MjModel) -> dict[str, str]:
    """Numbers of the naive MJCF and of the compiled model by the six digits that MuJoCo writes of them."""
    numbers = [float(n) for e in ElementTree.fromstring(xml).iter() for v in e.attrib.values() for n in _numbers(v)]
    arrays = [getattr(model, name) for name in dir(model) if name.startswith(KEPT)]
    arrays += [getattr(model.opt, name) for name in ("timestep", "gravity", "wind", "density", "viscosity")]
    for array in arrays:
        if isinstance(array, float) or getattr(array, "dtype", None) == np.float64:
            numbers += np.ravel(array).tolist()
    return {f"{number:.6g}": repr(number) for number in numbers}


def _numbers(value: str) -> list[str]:
    return [token for token in value.split() if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?", token, re.I)]


def _sharpen(tree: ElementTree.Element, exact: dict[str, str]) -> None:
    # MuJoCo writes six digits, which a long or chaotic simulation can tell from the fit.
    for element in tree.iter():
        for key, value in element.attrib.items():
            tokens = value.split()
            if key != "name" and tokens == _numbers(value):
                element.set(key, " ".join(t if t.lstrip("-").isdigit() else exact.get(t, t) for t in tokens))


def _carry_assets(tree: ElementTree.Element, source: Path, folder: Path) -> list[Path]:
    """Copy meshes, textures and height fields beside the model, and name them there."""
    dirs = {k: v for c in tree.iter("compiler") for k, v in c.attrib.items() if k in ("meshdir", "texturedir")}
    copies: dict[Path, Path] = {}
    for element in (e for a in tree.iter("asset") for e in a.iter()):
        root = source / dirs.get("texturedir" if element.tag == "texture" else "meshdir", "")
        for key in [k for k in element.attrib if k.startswith("file")]:
            origin = root / element.attrib[key]
            taken = {p.name for o, p in copies.items() if o != origin}
            inside = Path(ASSETS) if origin.name not in taken else Path(ASSETS) / str(len(copies))
            copies.setdefault(origin, inside / origin.name)
            element.set(key, copies[origin].as_posix())
    for compiler in tree.iter("compiler"):
        for key in dirs:
            compiler.attrib.pop(key, None)
    for origin, place in copies.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(origin, folder / place)
    return [folder / place for place in copies.values()]


def _without_field(diagnosis: Diagnosis) -> list[Placed]:
    return [p for p in diagnosis.naming.best.placed if p.effect.export is None]


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
        + f"\n\n    {use}\n\nOr step by step: Stepper(model, data).step(ctrl).\n"
    )


def _past(diagnosis: Diagnosis) -> int:
    placed = diagnosis.naming.best.placed
    return PAST if any(p.effect.enters == "command" and p.effect.export for p in placed) else 0


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
