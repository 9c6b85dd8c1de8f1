"""The improved model as an MJCF that plain MuJoCo loads, checked to predict what the improved simulation does.

Fields that MuJoCo has are written into `improved.xml`; a law that it lacks goes to `improved.py` beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from fimpact.effects.base import Placed, words
from fimpact.effects.native import editable, exporting, write_inferred_fields
from fimpact.effects.wiring import rotates_with_site
from fimpact.export import runtime_template
from fimpact.export.callback import SourceBundle, as_source_list
from fimpact.export.mjcf import carry_assets, exact, restore_full_precision
from fimpact.export.replay import CALLBACK, PAST, XML, Replay, stateful
from fimpact.recordings import FIELDS, Recording
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.nonsmooth import make_friction_exact
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.state_guess import noise_level
from fimpact.simulation.windows import Windows

AGREES = 0.02  # relative difference of error; finer numerics are written where coarser ones differ by more
RK4 = mujoco.mjtIntegrator.mjINT_RK4
NUMERICS = ((None, 0), (None, 1), (None, 2), (None, 3), (RK4, 0), (RK4, 2))  # integrator (None: own), halvings
ASKS_COMMANDS = ("force", "friction", "gear")  # laws that ask what the motors are told
LISTS = {
    "model": "EDITS",
    "force": "FORCES",
    "friction": "FRICTIONS",
    "gear": "GEARS",
    "command": "COMMANDS",
    "measurement": "MEASUREMENTS",
}


class Predicted(NamedTuple):
    """Windows that the improved simulation predicts, (w, T, ny), from the states at their starts."""

    windows: Windows
    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    prediction: np.ndarray


@dataclass(frozen=True)
class Exported:
    """Files written, and by how much their error in plain MuJoCo differs from the simulation's, relative to it; or
    none, and why not, in one sentence."""

    files: list[Path]
    difference: float | None = None
    refusal: str = ""


def write_model(
    recording: Recording, hypothesis: Hypothesis, folder: Path | str, summary: str, predicted: Predicted
) -> Exported:
    """Write `improved.xml`, the files that it loads and, where a law has no native field, `improved.py`.

    Integrator and time step are the naive model's if plain MuJoCo then predicts the windows as the simulation does;
    else the first of `NUMERICS` that does, or the one that comes nearest.

    Args:
        summary: what was found, in words, for the head of the files.
    """
    with TemporaryDirectory() as tried:
        differences = {}
        for numerics in NUMERICS:
            write_files(recording, hypothesis, Path(tried), summary, *numerics)
            differences[numerics] = check_model(recording, hypothesis, Path(tried), predicted)
            if differences[numerics] <= AGREES:
                break
    nearest = min(differences, key=differences.__getitem__)
    if not np.isfinite(differences[nearest]):
        return Exported([], refusal="No model is exported: in plain MuJoCo its simulation diverges.")
    Path(folder).mkdir(parents=True, exist_ok=True)
    return Exported(write_files(recording, hypothesis, Path(folder), summary, *nearest), differences[nearest])


def check_model(recording: Recording, hypothesis: Hypothesis, folder: Path, predicted: Predicted) -> float:
    """Compare errors of the files in `folder`, in plain MuJoCo, with those of the simulation: relative difference."""
    windows, *states, prediction = predicted
    lagging = any(p.effect.enters == "command" for p in _in_fields(recording, hypothesis))
    replayed = Replay(recording, folder, lagging).predict(windows, *states)
    noise, seen = noise_level(recording), np.isfinite(windows.measured)
    own, plain = (_rms(((windows.measured - found) / noise)[seen]) for found in (prediction, replayed))
    return float(abs(plain / own - 1)) if np.isfinite(plain) else np.inf


def improved_spec(
    recording: Recording, hypothesis: Hypothesis, integrator: int | None = None, halvings: int = 0
) -> mujoco.MjSpec:
    """Put fitted unknowns and the native fields of effects into the naive model.

    Args:
        integrator: None: the naive model's. halvings: of its time step.
    """
    simulator, spec = Simulator(recording), recording.spec()
    spec.option.timestep = simulator.base.opt.timestep / 2**halvings
    spec.option.integrator = spec.option.integrator if integrator is None else integrator
    write_inferred_fields(spec)
    for unknown, value in zip(recording.unknowns, hypothesis.theta, strict=True):
        put = FIELDS[unknown.field][2][1]
        exporting(lambda model, site, value, put=put: put(model, site, value))(spec, unknown.site, value=value)
    for placed in _in_fields(recording, hypothesis):
        assert placed.effect.export is not None  # of those that are in fields
        placed.effect.export(spec, placed.site, **placed.values)
    _export_friction(spec, simulator.base, hypothesis)
    _export_contacts(spec, simulator)
    return spec


def write_files(
    recording: Recording, hypothesis: Hypothesis, folder: Path, summary: str, integrator: int | None, halvings: int
) -> list[Path]:
    """Write the improved model into `folder`, with the assets that it loads and what it cannot hold."""
    spec = improved_spec(recording, hypothesis, integrator, halvings)
    model = spec.compile()
    tree = ElementTree.fromstring(spec.to_xml())
    restore_full_precision(tree, exact(recording.xml, model))
    assets = carry_assets(tree, Path(recording.folder), folder)
    ElementTree.indent(tree)
    laws = _without_field(recording, hypothesis)
    head = f"Improved by fimpact: {summary}" + f" {CALLBACK} holds the rest." * bool(laws)
    text = f"<!-- {head.replace('--', '- -')} -->\n{ElementTree.tostring(tree, encoding='unicode')}\n"
    (folder / XML).write_text(text, encoding="utf-8")
    if not laws:
        (folder / CALLBACK).unlink(missing_ok=True)  # of an earlier answer
        return [folder / XML, *assets]
    (folder / CALLBACK).write_text(_callback(recording, hypothesis, laws, summary), encoding="utf-8")
    return [folder / XML, folder / CALLBACK, *assets]


def _rms(error: np.ndarray) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.sqrt(np.mean(error**2)))


def _export_friction(spec: mujoco.MjSpec, base: mujoco.MjModel, hypothesis: Hypothesis) -> None:
    """Let added dry friction be exact (`solreffriction`), as it is in the simulation."""
    model = editable(spec)
    by_id = {joint.id: joint for joint in spec.joints}
    for dof in make_friction_exact(model, base, hypothesis.placed):
        joint = by_id[int(model.dof_jntid[dof])]
        joint.solref_friction, joint.solimp_friction = model.dof_solref[dof], model.dof_solimp[dof]


def _export_contacts(spec: mujoco.MjSpec, simulator: Simulator) -> None:
    """Make contacts no quicker than the naive model's time step allows, where the improved one's is finer."""
    if simulator.base.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
        return
    for element in (*spec.geoms, *spec.pairs):
        if 0 < element.solref[0] < simulator.quickest:
            element.solref = simulator.quickest, element.solref[1]


def _in_fields(recording: Recording, hypothesis: Hypothesis) -> list[Placed]:
    """Effects that fields of MuJoCo hold. Those that edit the model come first, as they do in our simulation: a
    cable is tied to where the centre of mass then is."""
    model = recording.spec().compile()
    asked = any(p.effect.export is None and p.effect.enters in ASKS_COMMANDS for p in hypothesis.placed)
    held = [p for p in hypothesis.placed if p.effect.export is not None and _holds(model, p, asked)]
    return sorted(held, key=lambda p: p.effect.enters != "model")


def _holds(model: mujoco.MjModel, placed: Placed, asked: bool) -> bool:
    """Whether native fields do what the law does here; asked: whether another law asks what the motors are told."""
    if placed.effect.enters == "command":
        return not asked  # MuJoCo's own lag sits behind the commands that such a law would see
    return placed.effect.enters != "measurement" or rotates_with_site(model, placed.site)


def _without_field(recording: Recording, hypothesis: Hypothesis) -> list[Placed]:
    held = _in_fields(recording, hypothesis)
    return [p for p in hypothesis.placed if p not in held]


def _callback(recording: Recording, hypothesis: Hypothesis, placed: Sequence[Placed], summary: str) -> str:
    constants = _constants(recording, hypothesis)
    bundle = SourceBundle(dict.fromkeys([*LISTS.values(), *constants], ""))
    for enters, name in LISTS.items():
        laws = [(p.effect.law, p.site, p.values) for p in placed if p.effect.enters == enters]
        constants[name] = as_source_list(bundle, laws)
    for thing in (runtime_template.load, runtime_template.simulate):
        bundle.add(thing)
    values = "\n".join(f"{name} = {text}" for name, text in constants.items())
    return f'"""{_explained(placed, summary)}"""\n\n{bundle.text()}\n\n{values}\n'


def _explained(placed: Sequence[Placed], summary: str) -> str:
    laws = [f"{_in_words(p)}\n    {p.effect.equation}\n    {p.effect.sentence}" for p in placed]
    use = f'model = load("{XML}")\n    measured = simulate(model, ctrl, qpos, qvel)'
    text = "\n\n".join([summary, *laws]).replace("\\", "/").replace('"""', "'''")
    return (
        f"What {XML} cannot hold, for plain MuJoCo: needs numpy and mujoco only. Written by fimpact.\n\n{text}"
        f"\n\n    {use}\n\nOr step by step: Stepper(model, data).step(ctrl).{_left_out(placed)}\n"
    )


def _in_words(placed: Placed) -> str:
    units = {c.name: c.unit for c in placed.effect.coefficients}
    values = (f"{name} = {value:.4g} {units.get(name, '')}".strip() for name, value in placed.values.items())
    return f"{words(placed.name)}: {', '.join(values)}"


def _left_out(placed: Sequence[Placed]) -> str:
    """What of the laws a single step cannot know, because it needs the whole run."""
    said = {
        "command": "\nIt takes what reaches the motors: a row of commands(ctrl, substeps)[0] in each time step.",
        "measurement": "\nIt returns what sensors truly read: measurements(rows, ctrl) is what they report of a run.",
    }
    return "".join(text for enters, text in said.items() if any(p.effect.enters == enters for p in placed))


def _constants(recording: Recording, hypothesis: Hypothesis) -> dict[str, str]:
    simulator = Simulator(recording)
    base = simulator.base
    signal = simulator.commands.describe(np.zeros((1, 1)), np.ones((1, 1, base.nu)))
    lagging = any(p.effect.enters == "command" for p in _in_fields(recording, hypothesis))
    values = {
        "PERIOD": float(recording.period),
        "PAST": PAST * lagging,
        "STATEFUL": stateful(base),
        "CHANNELS": tuple(recording.channels),
        "ACTUATORS": signal.actuators,
        "JOINT_OF": signal.joint_of,
        "DRIVEN_BY": signal.driven_by,
        "HOLDING": signal.holding,
        "GAINS": tuple(signal.force[0, 0].tolist()),
    }
    return {name: repr(value) for name, value in values.items()}
