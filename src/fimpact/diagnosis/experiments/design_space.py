"""The space of experiments: commands and starts within those that the recordings themselves used."""

from dataclasses import dataclass

import mujoco
import numpy as np

from fimpact.recordings import Recording
from fimpact.simulation.state_guess import measured_motion

KNOTS = 8  # per actuator
ABRUPT = 0.02  # share of the way between two knots in which the quickest commands change
QUICKEST = 4  # samples: the shortest period of a square wave on top, for what shows at a change of the command only
LONGEST = 4000  # samples of an experiment: a recording of minutes asks for no design of minutes


@dataclass(frozen=True)
class DesignSpace:
    """Bounds of a flat design, (d,), and how it becomes an experiment: the height of each knot, how gently commands go
    from one to the next, how much of its range each command takes for a square wave, how quick that is, 0 to 1, and
    the start."""

    low: np.ndarray
    high: np.ndarray
    samples: int
    model: mujoco.MjModel

    @property
    def nu(self) -> int:
        """Number of commands."""
        return self.model.nu

    def unpack(self, design: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Make the experiment: ctrl (T, nu), qpos (nq,), qvel (nv,)."""
        ends = np.cumsum([KNOTS * self.nu, 1, self.nu, 1])
        knots, gentle, shares, pace, start = np.split(design, ends)
        passed, part = np.divmod(np.linspace(0, KNOTS - 1, self.samples), 1.0)
        place = passed + np.clip((part - 0.5) / gentle[0] + 0.5, 0, 1)
        ctrl = [np.interp(place, np.arange(KNOTS), column) for column in knots.reshape(KNOTS, self.nu).T]
        low, high = (bound[: self.nu] for bound in (self.low, self.high))
        cycles = max(self.samples / QUICKEST, 1.0) ** pace[0]
        wave = np.where(np.arange(self.samples) * cycles / self.samples % 1.0 < 0.5, 0.5, -0.5)
        waved = np.array(ctrl).reshape(self.nu, self.samples).T + wave[:, None] * shares * (high - low)
        qpos, qvel = start[: self.model.nq].copy(), start[self.model.nq :]
        mujoco.mj_normalizeQuat(self.model, qpos)  # between two orientations lies none
        return np.clip(waved, low, high), qpos, qvel

    def draw(self, rng: np.random.Generator, count: int, waves: bool = False) -> np.ndarray:
        """Draw random designs, (count, d), without square waves or with them."""
        out = rng.uniform(self.low, np.maximum(self.high, self.low + 1e-9), (count, len(self.low)))
        out[:, KNOTS * self.nu + 1 : (KNOTS + 1) * self.nu + 1] *= waves
        return out

    def shrink(self, rng: np.random.Generator, designs: np.ndarray) -> np.ndarray:
        """Make the commands of `designs` smaller, each by a factor of its own."""
        out, commands = designs.copy(), slice(KNOTS * self.nu)
        out[:, commands] *= rng.uniform(0, 1, (len(designs), 1))
        return np.clip(out, self.low, self.high)


def limits(recording: Recording, model: mujoco.MjModel, noise: np.ndarray) -> DesignSpace:
    """Find the smallest and largest command of each actuator and state at a run's start, over the training runs.

    Args:
        noise: sd of the readings, (ny,).
    """
    ctrl = np.concatenate([run.ctrl for run in recording.training])
    start = np.array([_start(recording, model, run, noise) for run in recording.training])
    none, all_ = np.zeros(ctrl.shape[1] + 1), np.ones(ctrl.shape[1] + 1)
    low = np.concatenate([np.tile(ctrl.min(0), KNOTS), [ABRUPT], none, start.min(0)])
    high = np.concatenate([np.tile(ctrl.max(0), KNOTS), [1.0], all_, start.max(0)])
    samples = min(max(len(run.measured) for run in recording.training), LONGEST)
    return DesignSpace(low, high, samples, model)


def _start(recording: Recording, model: mujoco.MjModel, run, noise: np.ndarray) -> np.ndarray:
    """State at the start of a run, (nq + nv,): as it was believed, or else as the measurements show it."""
    if run.qpos is not None and run.qvel is not None:
        return np.concatenate([run.qpos, run.qvel])
    qpos, qvel, _ = measured_motion(model, recording, run, noise)
    return np.concatenate([qpos[0], qvel[0]])
