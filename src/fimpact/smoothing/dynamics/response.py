"""What a change of the plant does to every sample: a force where it is held over the sample, else simulated."""

import operator
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from fimpact.effects.wiring import ON_JOINT
from fimpact.simulation.servo_steps import is_long
from fimpact.smoothing.dynamics.inverse import EDITED, RESTING, Inverse, edits
from fimpact.smoothing.dynamics.laws import read_by
from fimpact.smoothing.dynamics.plant import Plant
from fimpact.smoothing.dynamics.sampled_commands import Commands
from fimpact.smoothing.dynamics.softness import Place, held_by, ratios, with_softer
from fimpact.smoothing.dynamics.track import Step
from fimpact.smoothing.states import States

NUDGE = 1e-6  # rad, m and their rates: step of a difference quotient of the state
CHANGED = 0.2  # of a number of the model: derivatives are renewed


@dataclass(frozen=True)
class Slopes:
    """Derivatives of each sample by coordinates of its state and missing force, m = n + nv: advance (N, n, m) of the
    next state, reads (N, ny, m) of the readings; plant: the one they belong to."""

    advance: np.ndarray
    reads: np.ndarray
    plant: Plant

    def hold(self, plant: Plant) -> bool:
        """Whether they are those of `plant` too, as well as a step needs them: what a gear that gives does to the next
        sample is told by little else."""
        values = ([law.values for law in own.rotors] for own in (self.plant, plant))
        return responds_alike(self.plant, plant) and operator.eq(*values)


def responds_alike(one: Plant, other: Plant) -> bool:
    """Whether two plants respond to what acts on them alike, but for a fifth of any number of their models and gears
    that give."""
    gears = [own.rotors for own in (one, other)]
    if [law.name for law in gears[0]] != [law.name for law in gears[1]]:
        return False
    values = [[value for law in own for value in law.values.values()] for own in gears]
    arrays = [([getattr(own.model, name) for name in EDITED], own.model.opt.gravity) for own in (one, other)]
    near = all(_alike(*pair) for pair in zip(*(own for own, _ in arrays), strict=True))
    return near and _alike(*values) and np.array_equal(*(gravity for _, gravity in arrays))


def _alike(one, other) -> bool:
    before, after = np.asarray(one, float), np.asarray(other, float)
    return not np.any(np.abs(after - before) > CHANGED * np.maximum(np.abs(before), np.abs(after)))


@dataclass(frozen=True)
class Change:
    """What something does: to the next state (N, n), to the readings (N, ny), as a force (N, nv)."""

    after: np.ndarray
    readings: np.ndarray
    force: np.ndarray

    def scaled(self, factor: float) -> "Change":
        """So many times the same."""
        return Change(self.after * factor, self.readings * factor, self.force * factor)

    def __add__(self, other: "Change") -> "Change":
        return Change(self.after + other.after, self.readings + other.readings, self.force + other.force)

    @property
    def finite(self) -> bool:
        """Whether it is a number everywhere, and something."""
        parts = self.after, self.readings, self.force
        return all(np.isfinite(own).all() for own in parts) and any(own.any() for own in parts)


class Response:
    """What changes of `plant` do along `states` with the missing force `tau`, (N, nv).

    All at the time step that the model itself has: a derivative hardly feels its error, but one at another step than
    its like makes of a steady push a drift.
    """

    def __init__(self, plant: Plant, states: States, tau: np.ndarray, like: "Response | None" = None):
        self.plant, self.states, self.tau = plant.coarse, states, tau
        self.track = plant.track
        self.long = is_long(plant.model, self.track.period)
        self.inverse: Inverse = like.inverse if like else Inverse(self.track, states)
        self.softness: dict[Place, Change] = like.softness if like else {}  # by those of what holds something
        self._told: tuple[Commands, Step] | None = None
        self.simulated = 0  # changes so far that took a simulation

    @cached_property
    def near(self) -> Step:
        """The samples ahead under the plant itself."""
        return self.plant.step(self.states, self.tau)

    def slopes(self, spread: np.ndarray | None = None) -> Slopes:
        """Derivatives by state and missing force: one simulation of all samples for each coordinate.

        Args:
            spread: sd of the missing force, (nv,), to both sides of which its derivative is taken; None: it is the
                tangent.
        """
        track, space, near = self.track, self.track.space, self.near
        # What is read at another time moves with the state then, which is nearer to a sample's own than to that before.
        late = [law for law in self.plant.placed if law.effect.shifts_time and law.effect.enters == "measurement"]
        plant = replace(self.plant, placed=tuple(law for law in self.plant.placed if law not in late))
        if late:
            near = plant.step(self.states, self.tau)
        n, nv = self.states.size, track.model.nv
        advance, reads = np.empty((track.count, n, n + nv)), np.empty((track.count, near.readings.shape[1], n + nv))
        tiny = 1e-4 * np.maximum(track.model.dof_M0, 1e-9) / track.period
        for j in range(n + nv):
            own, unit = (NUDGE, np.eye(n)[j]) if j < n else (tiny[j - n], np.eye(nv)[j - n])
            if j < n:
                found, other = (
                    plant.step(space.plus(self.states, np.tile(own * unit, (track.count, 1))), self.tau),
                    near,
                )
            elif spread is None:
                found, other = plant.step(self.states, self.tau + own * unit), near
            else:
                own = max(own, spread[j - n])
                found, other = (plant.step(self.states, self.tau + side * own / 2 * unit) for side in (1, -1))
            advance[:, :, j] = space.minus(found.after, other.after) / own
            reads[:, :, j] = (found.readings - other.readings) / own
        return Slopes(advance, reads, self.plant)

    def nothing(self) -> Change:
        """No change."""
        track = self.track
        sizes = self.states.size, len(track.recording.channels), track.model.nv
        return Change(*(np.zeros((track.count, size)) for size in sizes))

    def __call__(self, plant: Plant, told: Commands | None = None) -> Change:
        """What `plant` does more than this response's own.

        Args:
            told: commands under which both are judged; None: each under its own.
        """
        held = self._held(plant, told)
        if held is not None:
            return held
        near = self.near
        if told is not None:
            plant, near = replace(plant, ctrl=told), self._under(told)
        self.simulated += 1
        return self._more(plant, near, self.tau * heavier(plant.model, self.plant.model))

    def _more(self, plant: Plant, near: Step, tau: np.ndarray) -> Change:
        """What `plant` does with `tau`, (N, nv), more than `near`."""
        found = plant.coarse.step(self.states, tau)
        after = self.track.space.minus(found.after, near.after)
        return replace(self.nothing(), after=after, readings=found.readings - near.readings)

    def _held(self, plant: Plant, told: Commands | None) -> Change | None:
        # A force that follows the position hardly changes within a sample, however stiff the servo.
        edited = edits(plant.model, self.plant.model)
        rubs = not np.array_equal(plant.model.dof_frictionloss, self.plant.model.dof_frictionloss)
        simulated = self.long and not (edited and edited <= set(RESTING))
        gears = plant.rotors, self.plant.rotors
        # What a rotor does when its motor or its gear changes is no force on the link.
        simulated |= gears[0] != gears[1] or bool(gears[0] and edited)
        if rubs or simulated or (told is None and not plant.ctrl.same(self.plant.ctrl)):
            return None
        before, after = self.plant.model, plant.model
        force = self.inverse.change(after, before, (self.plant.ctrl if told is None else told).mean)
        if force is None:
            return None
        force = force + plant.force - self.plant.force + self.tau * (heavier(after, before) - 1.0)
        return self._softer(after, Change(self.nothing().after, self._read(plant), force))

    def _softer(self, after: mujoco.MjModel, held: Change) -> Change:
        """`held`, and what it does that contacts and limits are held more softly, or less, under `after`."""
        for place, ratio in ratios(self._holding, after, self.plant.model).items():
            if place not in self.softness:
                model, part = with_softer(self.plant.model, place)
                softer = self._more(replace(self.plant, models=(model,)), self.near, self.tau)
                self.softness[place] = softer.scaled(1 / part)
            held += self.softness[place].scaled(ratio)
        return held

    @cached_property
    def _holding(self) -> list[Place]:
        return held_by(self.track, self.plant.model, self.states)

    def _read(self, plant: Plant) -> np.ndarray:
        """What laws of sensors and gears change of the readings."""
        laws, own = plant.placed, self.plant.placed
        if laws == own or not any(p.effect.enters in ("measurement", "gear") for p in (*laws, *own)):
            return self.nothing().readings
        ends = []
        for beside in (plant, self.plant):
            found = self._raw
            for law in beside.placed:
                if law not in beside.rotors:
                    found = read_by(self.track, law, self.states, found, plant.surprise, beside.driven)
            ends.append(found.readings)
        return ends[0] - ends[1]

    @cached_property
    def _raw(self) -> Step:
        return self.plant.unread(self.states, self.tau)

    def _under(self, told: Commands) -> Step:
        if self._told is None or self._told[0] is not told:
            self._told = told, replace(self.plant, ctrl=told).step(self.states, self.tau)
        return self._told[1]


def heavier(after: mujoco.MjModel, before: mujoco.MjModel) -> np.ndarray:
    """By how much the inertia that each degree of freedom feels has grown, (nv,); 1 where a motor is.

    Where nothing applied is known, forces are known up to their scale only, and least squares of them has the solution
    that nothing weighs anything. There the missing force grows with the inertia: its acceleration is held.
    """
    grown = before.dof_invweight0 / np.maximum(after.dof_invweight0, 1e-300)
    return np.where(driven(before), 1.0, grown)


def driven(model: mujoco.MjModel) -> np.ndarray:
    """Whether a motor acts on each degree of freedom, (nv,)."""
    out = np.zeros(model.nv, bool)
    for motor in range(model.nu):
        if model.actuator_trntype[motor] != ON_JOINT:
            return np.ones(model.nv, bool)
        out |= model.dof_jntid == model.actuator_trnid[motor, 0]
    return out
