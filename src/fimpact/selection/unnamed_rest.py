"""What is left without a name: whether it follows one thing at one joint, on stretches to which nothing was fitted.

A smooth function of a joint's position, speed, load, time in the run or contact mode, alone or against the motion as
friction is, is no physics; but it tells whether and where physics is left, and a name that it beats is no name (Anau
Montel, Alvey, Weniger, arXiv 2412.15100). So does what may be loose in a body.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from fimpact.deciding import NOTHING as NONE
from fimpact.deciding import P_ALARM, REFINES, SHARE, UNLIKELY
from fimpact.effects.base import Coefficient, Effect
from fimpact.effects.touching import can_touch
from fimpact.effects.wiring import ON_JOINT
from fimpact.selection.carried_bodies import carried, sliding
from fimpact.selection.one_round import Trial, search
from fimpact.selection.options import Option
from fimpact.selection.regression import Regression
from fimpact.selection.substitutes import NOTHING, exchanges
from fimpact.selection.swaying_bases import swaying
from fimpact.smoothing.candidates import Candidate
from fimpact.smoothing.columns import columns
from fimpact.smoothing.dynamics.laws import expected_sign, middle, predicted_commands, speed_doubt
from fimpact.smoothing.noise_levels import CHANGE
from fimpact.smoothing.smoother import Smoothed

FREE = mujoco.mjtJoint.mjJNT_FREE
BESIDES = {"friction": ("speed",), "damping": ("speed", "load"), "gain": ("speed", "load")}  # forces of these already
KNOTS = 12  # of a smooth function, from the least to the most of what it follows
SWAY = "sway"
AS_HEAVY = 1.0  # as the mechanism is what it stands on


@dataclass(frozen=True)
class Leftover:
    """What is left without a name. dof, follows: where, and what it follows there, None: nothing smooth. share: of the
    squared force that was missing there; loudest: at which frequency, where it sways. doubted: names (``effect@site``)
    that explain less than half of what such a function does. instead: of names, how likely, beside the answer's 1 and
    at most that, they are wrong."""

    dof: int | None
    follows: str | None
    share: float
    doubted: tuple[str, ...]
    instead: dict[str, float] = field(default_factory=dict)
    loudest: str = ""


def leftover(fit: Smoothed, missing: np.ndarray) -> Leftover:
    """Regress what `fit` leaves on smooth functions; missing: squared force that the naive model lacks,
    (contact modes, nv)."""
    tried = smooth_functions(fit)
    regression = Regression(fit, columns(fit, tried))
    offered = [Option(own.name, 0, (i,)) for i, own in enumerate(tried)]
    best = next((t for t in search(regression, offered, missing, SHARE).tried if _shows(t)), None)
    # Nothing but a name can be what is left beside a name, but for mounts, whose sway is at all joints at once.
    mounts = [option for option in offered if option.name.startswith(SWAY)]
    others = exchanges(regression, offered, mounts)
    worth = {e.places: -e.better for e in others if e.option.name == NOTHING}
    likelier = [e for e in others if e.option.name != NOTHING and e.sure and e.weight > UNLIKELY]
    # No named law is exact: it is doubted where it explains less than half of what a smooth function does.
    stronger = {e.places[0] for e in likelier if e.weight * UNLIKELY > 1 and e.better > worth[e.places]}
    doubted = tuple(fit.placed[place].name for place in sorted(stronger))
    # What refines a law by less than a tenth leaves it a law.
    wrong = [e for e in reversed(likelier) if e.better > REFINES * worth[e.places]]  # the likeliest last
    instead = {fit.placed[e.places[0]].name: min(e.weight, 1.0) for e in wrong}
    if best is None:
        return Leftover(None, None, 0.0, doubted, instead)
    what, dof = best.option.name.split("@")
    return Leftover(int(dof), what, best.share, doubted, instead, _loudest(regression, best, int(dof)))


def _loudest(regression: Regression, trial: Trial, dof: int) -> str:
    """The frequency at which most of a sum of forces is, "" where it is no sum over frequencies."""
    columns, first = regression.columns, regression.p
    own = [(c, v) for c, v in zip(trial.estimate.kept, trial.estimate.values, strict=True) if c >= first]
    sizes = [abs(v) * np.sqrt(np.mean(columns.forces[:, dof, 1 + c] ** 2)) for c, v in own]
    member, weight = columns.owners[own[int(np.argmax(sizes))][0] - first]
    return columns.candidates[member].effect.coefficients[weight].unit


def _shows(trial: Trial) -> bool:
    return trial.p < P_ALARM and (trial.sure > 0 or trial.trusted) and trial.share > SHARE


def smooth_functions(fit: Smoothed) -> list[Candidate]:
    """Hat functions of all that may be followed: forces, alone or against the motion as friction and damping are, or
    with the motor's as a gain is, and pushes on bodies; what may slide in these, and mounts that may sway. Nothing
    while a contact begins or ends, where what is missing is what an impact within a sample leaves."""
    states, doubt = fit.states, speed_doubt(fit.track, fit.states, fit.doubt)
    speed = middle(fit.track, states)[1]
    against, calm = -expected_sign(speed, doubt), 1.0 * (fit.levels.mode != CHANGE)
    found = []
    for dof, followed in _followed(fit):
        along, load = _unit(fit, dof), followed.get("load", np.zeros(fit.track.count))
        kinds = {"": 1.0, "friction": against[:, dof], "damping": -speed[:, dof], "gain": load}
        for kind, times in kinds.items():
            for what, values in followed.items():
                if what not in BESIDES.get(kind, ()):
                    name = f"{kind} with {what}" if kind else what
                    found.append(_smooth(fit, dof, name, values, [(calm * times)[:, None] * along]))
    for body in carried(fit):
        found.append(_smooth(fit, body.dof, "push with time", fit.track.time, calm[:, None] * body.push))
        for axis, slides in sliding(fit.track, body, KNOTS):
            found.append(_weighted(body.dof, f"slide with pull along {axis}", calm[:, None, None] * slides, body.mass))
    for dof, axis, sways, rates in swaying(fit, KNOTS):
        found.append(_weighted(dof, f"{SWAY} with push along {axis}", calm[:, None, None] * sways, AS_HEAVY, rates))
    return [own for own in found if own]


def _followed(fit: Smoothed) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Degree of freedom, and by name what may be followed there along the motion, (N,)."""
    track, model = fit.track, fit.track.model
    qpos, qvel = middle(track, fit.states)
    load = predicted_commands(track, track.ctrl, fit.tau).mean(1)
    motors = {model.jnt_dofadr[model.actuator_trnid[m, 0]]: m for m in range(model.nu) if _on_joint(model, m)}
    for dof in range(model.nv):
        joint = model.dof_jntid[dof]
        first, kind = dof - model.jnt_dofadr[joint], mujoco.mjtJoint(model.jnt_type[joint])
        found = {"speed": qvel[:, dof], "time": track.time}
        if kind in (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE) or (first < 3 and kind == FREE):
            found["position"] = qpos[:, model.jnt_qposadr[joint] + first]
        if dof in motors:
            found["load"] = load[:, motors[dof]]
        if can_touch(model):
            found["contact"] = fit.levels.mode
        yield dof, found


def _on_joint(model: mujoco.MjModel, motor: int) -> bool:
    return model.actuator_trntype[motor] == ON_JOINT


def _unit(fit: Smoothed, dof: int) -> np.ndarray:
    return np.eye(fit.track.model.nv)[dof]


def _smooth(fit: Smoothed, dof: int, what: str, values: np.ndarray, forces: Sequence[np.ndarray]) -> Candidate | None:
    """Hat functions of what is followed times each of `forces`, (N, nv), each as large as the force that is left; None
    where nothing of it changes anything."""
    if what.endswith("contact"):
        knots = np.unique(values)
    else:
        low, high = np.quantile(values, [0.01, 0.99])
        knots = np.linspace(low, high, KNOTS)
    size = float(np.sqrt(np.mean(fit.tau[:, dof] ** 2)))
    units = [float(np.sqrt(np.mean(force[:, dof] ** 2))) for force in forces]
    acting = [force / unit for force, unit in zip(forces, units, strict=True) if unit > NONE * max(units)]
    if not (np.diff(knots) > 0).all() or len(knots) < 2 or not size > 0 or not acting:
        return None
    rows = np.array([np.interp(values, knots, one) for one in np.eye(len(knots))]).T
    return _weighted(dof, what, np.concatenate([rows[:, :, None] * force[:, None] for force in acting], 1), size)


def _weighted(dof: int, what: str, rows: np.ndarray, size: float, rates: np.ndarray | None = None) -> Candidate:
    """A sum of forces, (N, weights, nv), each about `size` times; rates: frequency of each, Hz."""
    names = tuple(f"w{i}" for i in range(rows.shape[1]))
    coefficients = tuple(Coefficient(name, "") for name in names)
    if rates is not None:
        coefficients = tuple(Coefficient(name, f"{rate:.2g} Hz") for name, rate in zip(names, rates, strict=True))

    def law(state, site, **weights):
        return np.array([weights[name] for name in names]) @ rows

    none = dict.fromkeys(names, 0.0)
    effect = Effect(
        what, "leftover", "", "", "", "force", coefficients, lambda *_: [], lambda *_: [], law, none,
    )  # fmt: skip
    some = dict.fromkeys(names, size)
    return Candidate(effect, str(dof), {}, names, (size,) * len(names), (False,) * len(names), some, {}, some)
