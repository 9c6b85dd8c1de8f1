"""What was recorded, and the model it is compared with: the only thing that a diagnosis is given."""

from dataclasses import dataclass

import mujoco
import numpy as np

WEIGHTLESS = int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)


@dataclass(frozen=True)
class Unknown:
    """A parameter of the naive model that is fitted.

    field: one of `FIELDS`. site: name of the body, joint, geom or contact pair that has it. sd: prior standard
    deviation, relative to the model's own value where that is not zero, else in the field's unit; inf: no prior.
    """

    field: str
    site: str
    sd: float = np.inf

    @property
    def name(self) -> str:
        """``field@site``, as tables name it."""
        return f"{self.field}@{self.site}"


@dataclass(frozen=True)
class Run:
    """One recording on a uniform time base.

    ctrl: (T, nu) in the actuators' units, held over each period. measured: (T, ny), NaN where missing.
    qpos, qvel: (nq,), (nv,) the state believed at its start, or None where the measurements show it. opens: whether it
    begins where the robot did: what is known of that says nothing of the later part of a run that was cut.
    """

    name: str
    ctrl: np.ndarray
    measured: np.ndarray
    held_out: bool
    qpos: np.ndarray | None = None
    qvel: np.ndarray | None = None
    opens: bool = True


@dataclass(frozen=True)
class Recording:
    """Runs of one rig and the naive model of it.

    xml: the naive MJCF, with one named sensor per channel. folder: where its meshes are. period: s.
    channels: names of the MJCF sensors measured, (ny,) counted by scalar components; a vector sensor is given
    as ``name[0]``, ``name[1]``, ... unknowns: what is fitted. noise: sd of each channel where known, else NaN.
    start_sd: prior standard deviation of qpos and qvel (2 nv,) at the start of each run that `opens`, inf: none.
    window: length of the windows in s, 0: whole runs. windows: how many of the training runs' are fitted, 0: all.
    notes: lines about how the log was read, for its owner.
    """

    xml: str
    folder: str
    period: float
    channels: tuple[str, ...]
    runs: tuple[Run, ...]
    unknowns: tuple[Unknown, ...]
    noise: np.ndarray
    start_sd: np.ndarray
    window: float
    windows: int = 0
    notes: tuple[str, ...] = ()

    def spec(self) -> mujoco.MjSpec:
        """A fresh MjSpec of the naive model, as `spec_of` has it."""
        return spec_of(self.xml)

    @property
    def training(self) -> tuple[Run, ...]:
        """Runs that may be fitted."""
        return tuple(run for run in self.runs if not run.held_out)

    @property
    def held_out(self) -> tuple[Run, ...]:
        """Runs that only judge."""
        return tuple(run for run in self.runs if run.held_out)


def spec_of(xml: str) -> mujoco.MjSpec:
    """A fresh MjSpec of an MJCF; gravity that a flag switches off is none, so that a lean can be tried."""
    spec = mujoco.MjSpec.from_string(xml)
    if spec.option.disableflags & WEIGHTLESS:
        spec.option.gravity = np.zeros(3)
        spec.option.disableflags &= ~WEIGHTLESS
    return spec


def _scale_inertial(model: mujoco.MjModel, body: int, value: float) -> None:
    model.body_inertia[body] *= value / model.body_mass[body]
    model.body_mass[body] = value


def _entry(array: str, kind: str, *index: int):
    """Getter and setter of one number of a model array that belongs to a named object."""

    def place(model, site):
        address = {"dof": lambda: model.joint(site).dofadr[0]}.get(kind, lambda: getattr(model, kind)(site).id)()
        return (address, *index)

    def get(model, site):
        return float(getattr(model, array)[place(model, site)])

    def put(model, site, value):
        rows = model.dof_jntid == model.joint(site).id if kind == "dof" else place(model, site)
        getattr(model, array)[rows] = value

    return get, put


def _scaled(get, array: str, kind: str):
    def put(model, site, value):
        getattr(model, array)[getattr(model, kind)(site).id] *= value / get(model, site)

    return get, put


def _slide_pair(model: mujoco.MjModel, site: str, value: float) -> None:
    model.pair_friction[model.pair(site).id, :2] = value


# field -> unit, whether it must stay positive, (get, set)
FIELDS = {
    "mass": ("kg", True, (_entry("body_mass", "body")[0], lambda m, s, v: _scale_inertial(m, m.body(s).id, v))),
    "inertia": (
        "kg m^2",
        True,
        _scaled(lambda m, s: float(m.body_inertia[m.body(s).id].max()), "body_inertia", "body"),
    ),
    "com_x": ("m", False, _entry("body_ipos", "body", 0)),
    "com_y": ("m", False, _entry("body_ipos", "body", 1)),
    "com_z": ("m", False, _entry("body_ipos", "body", 2)),
    "damping": ("N m s/rad", True, _entry("dof_damping", "dof")),
    "armature": ("kg m^2", True, _entry("dof_armature", "dof")),
    "frictionloss": ("N m", True, _entry("dof_frictionloss", "dof")),
    "stiffness": ("N m/rad", True, _entry("jnt_stiffness", "joint")),
    "pair_friction": ("", True, (_entry("pair_friction", "pair", 0)[0], _slide_pair)),
    "friction": ("", True, _entry("geom_friction", "geom", 0)),
    "height": ("m", False, _entry("geom_pos", "geom", 2)),
}
