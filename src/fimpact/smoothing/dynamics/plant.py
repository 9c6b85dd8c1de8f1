"""What a hypothesis makes of each sample: its model, its commands, and forces of laws that MuJoCo lacks."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from fimpact.effects.base import Placed
from fimpact.simulation.nonsmooth import stop_within_a_step
from fimpact.smoothing.dynamics.dry_friction import Rubbing, rubbing
from fimpact.smoothing.dynamics.gear_laws import Driven
from fimpact.smoothing.dynamics.laws import DRY, force_of, read_by
from fimpact.smoothing.dynamics.rotor_states import turning
from fimpact.smoothing.dynamics.sampled_commands import Commands
from fimpact.smoothing.dynamics.track import Step, Track
from fimpact.smoothing.states import States


@dataclass(frozen=True)
class Plant:
    """What a hypothesis makes of each sample: the model at its time steps, commands, forces of laws, (N, nv), dry
    friction among them, along the states `around`, and what readings there hold beyond what was foretold, (N, ny).

    dry: friction that is taken out of the models, (nv,), where it is held over a sample.
    """

    track: Track
    models: tuple[mujoco.MjModel, ...]
    placed: tuple[Placed, ...]
    ctrl: Commands
    force: np.ndarray
    rubbing: Rubbing
    around: States
    tau: np.ndarray
    dry: np.ndarray
    surprise: np.ndarray | float = 0.0

    @property
    def model(self) -> mujoco.MjModel:
        """The model at its own time step."""
        return self.models[0]

    @property
    def driven(self) -> Driven:
        """What drives its gears."""
        return Driven(self.model, self.ctrl.mean)

    @property
    def rotors(self) -> tuple[Placed, ...]:
        """Its gears of which the rotor has states of its own."""
        return turning(self.track, self.placed)

    @property
    def plain(self) -> "Plant":
        """The same at one time step only: a derivative hardly feels the step's error."""
        return replace(self, models=self.models[:1])

    @property
    def coarse(self) -> "Plant":
        """The same at the time step that the model itself has."""
        simulator = self.track.simulator
        substeps = max(round(simulator.substeps / simulator.refine), 2)
        if substeps >= simulator.substeps:
            return self.plain
        model = copy.copy(self.model)
        model.opt.timestep = self.track.period / substeps
        if self.track.long:
            stop_within_a_step(model)
        return replace(self, models=(model,))

    def step(self, states: States, tau: np.ndarray) -> Step:
        """One sample ahead of each state with the missing force `tau` (N, nv)."""
        found = self.unread(states, tau)
        for law in self.placed:
            if law not in self.rotors:
                found = read_by(self.track, law, self.around, found, self.surprise, self.driven)
        return found

    def unread(self, states: States, tau: np.ndarray) -> Step:
        """The same as it is, whatever sensors make of it."""
        return self.track.ahead(self.models, states, self.ctrl, self.force + tau, self.rotors)


def plant_of(
    track: Track,
    placed: Sequence[Placed],
    theta: np.ndarray,
    states: States,
    tau: np.ndarray,
    doubt: np.ndarray,
    sign: np.ndarray | None = None,
    surprise: np.ndarray | float = 0.0,
) -> Plant:
    """The plant of a hypothesis; laws that MuJoCo lacks act as they do along `states`.

    Args:
        tau: missing force, (N, nv). doubt: sd of the speeds, (N, nv). sign: of the speeds for dry friction, where it is
            known already. surprise: as in `laws.read_by`.
    """
    model = track.model_of(placed, theta)
    dry = _taken_dry(track, model)
    laws = [law for law in placed if law.effect.enters == "friction"]
    rub = rubbing(track, model, dry, laws, states, tau, doubt, sign)
    rotors = turning(track, placed)
    force, models, ctrl = rub.force.copy(), track.at_steps(model), track.commands(placed)
    for law in placed:
        if law.effect.enters != "friction" and law not in rotors:
            force += force_of(track, law, states, tau, doubt, Driven(model, ctrl.mean))
    return Plant(track, models, tuple(placed), ctrl, force, rub, states, tau, dry, surprise)


def _taken_dry(track: Track, model: mujoco.MjModel) -> np.ndarray:
    """Take dry friction out of `model`; returns it, (nv,).

    The model's own, too: real friction turns over with the speed, MuJoCo's some milliseconds later.
    """
    if track.long:
        stop_within_a_step(model)
        return np.zeros(model.nv)
    dry = model.dof_frictionloss.copy()
    for name in DRY:
        getattr(model, name)[:] = getattr(track.model, name)
    model.dof_frictionloss[:] = 0.0
    return dry
