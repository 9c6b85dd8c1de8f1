"""What a system is: an MJCF, its unknown parameters, its inputs and its sensor."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import Any

from fimpact.paper.mjx.engine import mjx

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

FAR = 1e3  # m, up to which gaps are measured


@dataclass(frozen=True)
class Parameter:
    """One unknown: nominal value and bounds in `unit`; the prior is relative and shared by all of a system."""

    name: str
    unit: str
    nominal: float
    low: float
    high: float


@dataclass(frozen=True)
class Inputs:
    """What the experimenter chooses: `names`, each drawn between `low` and `high`, at `knots` instants."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    knots: int

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the flat design vector, shape (knots * len(names),)."""
        return np.tile(self.low, self.knots), np.tile(self.high, self.knots)


@dataclass(frozen=True)
class Sensor:
    """What is measured: channels and the standard deviation of white noise, both in `unit`."""

    name: str
    unit: str
    channels: tuple[str, ...]
    noise: float


@dataclass(frozen=True, eq=False)
class System:
    """A robot, its surface and its experiment.

    `edit` writes parameters and settings into an MjSpec (used to compile models for MuJoCo C);
    `revise` writes the same parameters into an MJX model, differentiably. The two share no code, so the
    simulated truth cannot inherit an error of the estimator. `launch` turns a flat design vector into
    (qpos, qvel, ctrl) with ctrl of shape (steps, nu). `sense` is the paper's sensor equation on MJX data;
    `instrument` is MuJoCo's own sensor of the same: its name in the MJCF, and which of its numbers.
    """

    name: str
    settings: dict[str, Any]
    parameters: tuple[Parameter, ...]
    inputs: Inputs
    sensor: Sensor
    edit: Callable[[mujoco.MjSpec, np.ndarray, dict], None]
    revise: Callable[[mjx.Model, jax.Array, dict], mjx.Model]
    launch: Callable[["System", jax.Array], tuple[jax.Array, jax.Array, jax.Array]]
    sense: Callable[[mjx.Model, mjx.Data, jax.Array], jax.Array]
    instrument: tuple[str, tuple[int, ...]]

    @property
    def steps(self) -> int:
        """Number of simulation steps, and of measurements, in one experiment."""
        return self.settings["steps"]

    @cached_property
    def nominal(self) -> np.ndarray:
        """Nominal parameters, shape (p,), in the units of `parameters`."""
        return np.array([p.nominal for p in self.parameters])

    @cached_property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper limits of the relative parameters theta / nominal, shape (p,) each."""
        low, high = ([getattr(p, side) for p in self.parameters] for side in ("low", "high"))
        return np.array(low) / self.nominal, np.array(high) / self.nominal

    def compile(self, theta: np.ndarray) -> mujoco.MjModel:
        """MuJoCo C model of the system with parameters `theta`, shape (p,), in physical units."""
        return self._spec(theta).compile()

    def compile_with_gaps(self, theta: np.ndarray) -> mujoco.MjModel:
        """The same, with the gap of every contact pair as one more sensor, last."""
        spec, geom = self._spec(theta), mujoco.mjtObj.mjOBJ_GEOM
        for pair in spec.pairs:
            ends = {"objtype": geom, "objname": pair.geomname1, "reftype": geom, "refname": pair.geomname2}
            spec.add_sensor(type=mujoco.mjtSensor.mjSENS_GEOMDIST, cutoff=FAR, **ends)
        return spec.compile()

    def _spec(self, theta: np.ndarray) -> mujoco.MjSpec:
        spec = mujoco.MjSpec.from_string(files("fimpact.paper.systems").joinpath(f"{self.name}.xml").read_text())
        spec.option.timestep = self.settings["timestep"]
        self.edit(spec, np.asarray(theta, float), self.settings)
        return spec

    @cached_property
    def template(self) -> mjx.Model:
        """MJX model at the nominal parameters; every number in it is a run-time argument of the programs.

        It has no sensors: MJX knows fewer of them, and `sense` takes their place.
        """
        spec = self._spec(self.nominal)
        for sensor in spec.sensors:
            spec.delete(sensor)
        return mjx.put_model(spec.compile())

    def gauge(self, model: mujoco.MjModel) -> np.ndarray:
        """Places of the measurement, (ny,), among the sensor data of `model`."""
        name, numbers = self.instrument
        return model.sensor(name).adr[0] + np.array(numbers)

    def read(self, model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
        """MuJoCo's own measurement, (ny,), of the step that `data` has just made."""
        return data.sensordata[self.gauge(model)]


def parameters(table: dict[str, dict], names: Sequence[str] = ()) -> tuple[Parameter, ...]:
    """Parameters from the configuration's table name -> {unit, nominal, bounds}.

    Args:
        names: those that the system knows, in its order; none: any, in the order of the table.

    Raises:
        ValueError: the table has other names.
    """
    if names and set(names) != set(table):
        raise ValueError(f"parameters are {', '.join(table)}; allowed: all of {', '.join(names)}; correct the table")
    table = {name: table[name] for name in names or table}
    return tuple(Parameter(name, row["unit"], row["nominal"], *row["bounds"]) for name, row in table.items())


def interpolate(knots: jax.Array, steps: int) -> jax.Array:
    """Piecewise linear signal, shape (steps, n), through `knots`, shape (k, n), equally spaced in time."""
    place = jnp.linspace(0.0, knots.shape[0] - 1.0, steps)
    return jax.vmap(lambda column: jnp.interp(place, jnp.arange(knots.shape[0]), column), 1, 1)(knots)


def total_contact_force(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Sum over all contacts of MuJoCo's force on the second geom, in world axes, shape (3,), N."""
    total = np.zeros(3)
    for index in range(data.ncon):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, index, force)
        total += data.contact[index].frame.reshape(3, 3).T @ force[:3]
    return total
