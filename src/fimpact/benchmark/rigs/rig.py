"""What a simulated rig is: naive model, what is recorded and how well, what is fitted."""

from dataclasses import dataclass, field
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
    disturbance: (nv,) relative size of the coloured disturbance on each degree of freedom. plane: in which it moves,
    "" where it moves in space. size: torques that matter there, in units of those of the planar arms. current: (nu,)
    sd, N m, with which motor currents tell the torque, on which as much ripple stands; empty where commands are known.
    stiff, damp, limit: (nu,) of the controller that moves it, N m/rad, N m s/rad and N m; empty where none is needed.
    text: MJCF, instead of that in the file of this name.
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
    plane: str = "xy"
    size: float = 1.0
    current: np.ndarray = field(default_factory=lambda: np.zeros(0))
    stiff: np.ndarray = field(default_factory=lambda: np.zeros(0))
    damp: np.ndarray = field(default_factory=lambda: np.zeros(0))
    limit: np.ndarray = field(default_factory=lambda: np.zeros(0))
    text: str = ""

    @cached_property
    def xml(self) -> str:
        """The naive MJCF."""
        return self.text or files("fimpact.benchmark.rigs").joinpath(f"{self.name}.xml").read_text()

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

    def serves(self) -> bool:
        """Whether its motors are told where to be."""
        return bool(self.naive.actuator_biasprm[:, 1].any())

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints that motors drive, in their order."""
        return tuple(self.naive.joint(joint).name for joint in self.naive.actuator_trnid[:, 0])


def _address(model: mujoco.MjModel, channel: str) -> int:
    name, _, index = channel.partition("[")
    return model.sensor(name).adr[0] + int(index.rstrip("]") or 0)
