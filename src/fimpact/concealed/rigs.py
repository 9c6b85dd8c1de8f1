"""The three rigs that are simulated: naive model, what is recorded and how well, what is fitted."""

from dataclasses import dataclass, replace
from functools import cached_property
from importlib.resources import files

import mujoco
import numpy as np

from fimpact.recordings import Unknown

CLOCK = 5e-5  # s, how late the clock of a run can be against that of its commands


@dataclass(frozen=True)
class Rig:
    """A rig and its instruments.

    period: s between samples. fine, coarse: steps per period of the truth and of its coarse copy; the naive model's
    step is that of the copy, the truth's a tenth of it or less. channels: as in `Recording`. noise, quantum: (ny,) sd
    and resolution of each channel. unknowns: fitted parameters. start_sd: (2 nv,) how well the start of a run is known,
    inf: not at all. window: s, 0: whole runs. duration: s. training, held_out: numbers of runs.
    disturbance: (nv,) relative size of the coloured disturbance on each degree of freedom.
    """

    name: str
    period: float
    fine: int
    coarse: int
    channels: tuple[str, ...]
    noise: np.ndarray
    quantum: np.ndarray
    unknowns: tuple[Unknown, ...]
    start_sd: np.ndarray
    window: float
    duration: float
    training: int
    held_out: int
    disturbance: np.ndarray

    @cached_property
    def xml(self) -> str:
        """The naive MJCF."""
        return files("fimpact.concealed").joinpath(f"{self.name}.xml").read_text()

    @cached_property
    def naive(self) -> mujoco.MjModel:
        """The naive model, compiled; not to be edited."""
        return mujoco.MjModel.from_xml_string(self.xml)

    @cached_property
    def columns(self) -> np.ndarray:
        """Address in `sensordata` of each channel, (ny,)."""
        return np.array([_address(self.naive, channel) for channel in self.channels])

    @property
    def samples(self) -> int:
        """Number of samples of a run."""
        return round(self.duration / self.period)

    @property
    def sd(self) -> np.ndarray:
        """Standard deviation of each channel, rounding included, (ny,)."""
        return np.sqrt(self.noise**2 + self.quantum**2 / 12)

    def throws(self) -> bool:
        """Whether a run is chosen by its initial state instead of its commands."""
        return self.naive.nu == 0


def _address(model: mujoco.MjModel, channel: str) -> int:
    name, _, index = channel.partition("[")
    return model.sensor(name).adr[0] + int(index.rstrip("]") or 0)


ENCODERS = tuple(f"encoder_{i}" for i in (1, 2, 3))
ARM = Rig(
    name="arm_free",
    period=0.005,
    fine=20,
    coarse=1,
    channels=ENCODERS,
    noise=np.full(3, 2e-3),
    quantum=np.full(3, 2 * np.pi / 2**13),
    unknowns=tuple(Unknown("mass", f"link_{i}", 0.12) for i in (1, 2, 3))
    + tuple(Unknown("damping", f"joint_{i}", 0.2) for i in (1, 2, 3)),
    start_sd=np.full(6, np.inf),
    window=0.4,
    duration=2.0,
    training=8,
    held_out=4,
    disturbance=np.array([1.0, 0.6, 0.3]),
)
PRESSING = replace(
    ARM,
    name="arm_contact",
    fine=20,
    window=0.2,
    duration=1.6,
    training=7,
    held_out=3,
    coarse=2,
    channels=(*ENCODERS, "wrist_force[0]", "wrist_force[1]"),
    noise=np.array([2e-3, 2e-3, 2e-3, 0.4, 0.4]),
    quantum=np.array([*ARM.quantum, 0.1, 0.1]),
)
BLOCK = Rig(
    name="block",
    period=0.0025,
    fine=20,
    coarse=2,
    channels=("camera_x", "camera_z", "camera_pitch", "imu[0]", "imu[2]"),
    noise=np.array([1e-3, 1e-3, 5e-3, 2.0, 2.0]),
    quantum=np.array([2e-4, 2e-4, 1e-3, 0.05, 0.05]),
    unknowns=(Unknown("inertia", "block", 0.12), Unknown("com_x", "block", 0.002), Unknown("com_z", "block", 0.002)),
    start_sd=np.array([2e-3, 2e-3, 0.01, 0.05, 0.05, 0.3]),
    window=0.125,
    duration=0.5,
    training=18,
    held_out=6,
    disturbance=np.array([1.0, 1.0, 0.03]),
)
RIGS = {rig.name: rig for rig in (ARM, PRESSING, BLOCK)}


def rig_of(name: str) -> Rig:
    """The rig `name`. Raises ValueError listing the rigs there are."""
    if name not in RIGS:
        raise ValueError(f"no rig is called {name!r}; there are {', '.join(RIGS)}")
    return RIGS[name]
