"""The model around a trajectory: what each coordinate, force and number does to the next sample and the readings."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fimpact.deciding import NOTHING
from fimpact.effects.base import Placed
from fimpact.smoothing.dynamics.clock import beside, rates
from fimpact.smoothing.dynamics.plant import Plant, plant_of
from fimpact.smoothing.dynamics.response import Change, Response, Slopes
from fimpact.smoothing.dynamics.rotor_states import starts_of_rotors
from fimpact.smoothing.dynamics.track import Step, Track
from fimpact.smoothing.parameters import Parameter, placed_of, theta_of
from fimpact.smoothing.states import States

WIDE = 10.0  # times what a run shows: prior sd of a first state of which nothing is known


@dataclass(frozen=True)
class Linear:
    """The model around a trajectory: m = n + nv coordinates and forces, p numbers.

    Where anything is commanded, the clock of the run is the last of the n coordinates; `rubbed` is without it.
    advance: (N, n, m) of the next state. reads: (N, ny, m) of the readings. offsets: (N, n, 1 + p) and left: (N, ny,
    1 + p): defects and what is left of the readings, and what the numbers do to both. first, spread: (runs, n) from
    each run's first state to its prior, and the prior's sd. base: the sample ahead of each state. rubbed: (N, n, n)
    what dry friction does to whatever moves the next state. changes: of each number by its name and place, with its
    value, what a unit of its coordinate does.
    """

    plant: Plant
    base: Step
    response: Response
    slopes: Slopes
    changes: dict[tuple[str, str], Change]
    advance: np.ndarray
    reads: np.ndarray
    offsets: np.ndarray
    left: np.ndarray
    first: np.ndarray
    spread: np.ndarray
    rubbed: np.ndarray

    def moved(self, after: np.ndarray) -> np.ndarray:
        """What becomes of changes of the next state, (N, n, c), with dry friction, and of the clock nothing."""
        return beside(self.rubbed @ after, self.advance.shape[1] - after.shape[1], 0, 0)


def linearise(
    track: Track,
    numbers: Sequence[Parameter],
    placed: Sequence[Placed],
    states: States,
    tau: np.ndarray,
    doubt,
    theta=None,
    like: Linear | None = None,
    sign: np.ndarray | None = None,
    rough: bool = False,
    surprise: np.ndarray | float = 0.0,
    spread: np.ndarray | None = None,
) -> Linear:
    """Linearise every sample.

    Args:
        numbers: what is estimated. theta: values of the unknowns where they are not among the numbers.
        like: the same along a trajectory so near that its derivatives hold, unless the model itself has changed.
        sign: of the speeds for dry friction, where it is known already. rough: the error of the time step counts
            little. surprise: as in `laws.read_by`. spread: as in `Response.slopes`.
    """
    placed = placed_of(numbers, placed)
    theta = theta_of(numbers) if theta is None else theta
    plant = plant_of(track, placed, theta, states, tau, doubt, sign, surprise)
    kept = like if like is not None and like.slopes.hold(plant) else None
    response = Response(plant, states, tau, None if kept is None else kept.response)
    slopes = response.slopes(spread) if kept is None else kept.slopes
    changes = {}
    for index, number in enumerate(numbers):
        known = None if kept is None or not response.long else kept.changes.get((number.of, number.name))
        changes[number.of, number.name] = known or _moved(response, numbers, placed, index, doubt, sign)
    base = response.near if rough else plant.step(states, tau)
    columns = [(c.after + _ahead(slopes, c), -c.readings - _read(slopes, c)) for c in changes.values()]
    offsets = np.stack([track.space.minus(base.after, track.next(states)), *(own for own, _ in columns)], 2)
    left = np.stack([np.nan_to_num(track.measured - base.readings), *(own for _, own in columns)], 2)
    first, spread = _starts(plant, states)
    rubbed, advance, reads = _rubbed(plant, slopes)
    own = Linear(plant, base, response, slopes, changes, advance, reads, rubbed @ offsets, left, first, spread, rubbed)
    return _timed(own, rates(track, base))


def _timed(own: Linear, rate: np.ndarray | None) -> Linear:
    """With the clock of each run as one more coordinate, which moves the readings by `rate` and itself never."""
    if rate is None:
        return own
    n, runs = own.advance.shape[1], len(own.first)
    advance, reads = beside(own.advance, 1, 1, n), beside(own.reads, 0, 1, n)
    advance[:, n, n], reads[:, :, n] = 1.0, rate
    first, spread = np.hstack([own.first, np.zeros((runs, 1))]), np.hstack([own.spread, np.ones((runs, 1))])
    return replace(own, advance=advance, reads=reads, offsets=beside(own.offsets, 1, 0, 0), first=first, spread=spread)


def missing_at_first(track: Track, linear: Linear) -> np.ndarray:
    """The force, (N, nv), that takes each sample's state to the next's.

    Positions count beside speeds: under a stiff servo a held force moves a joint, and its speed has died away.
    """
    tau = np.einsum("kji,ki->kj", inverse_of_push(track, linear), -linear.offsets[:, : 2 * track.model.nv, 0])
    tau[track.last] = 0.0
    return tau


def inverse_of_push(track: Track, linear: Linear, sticks: bool = True) -> np.ndarray:
    """The force that a change of the next sample's positions and speeds would take, (N, nv, 2 nv).

    Args:
        sticks: under stiff servos none where a joint sticks, which no force of that size moves; False: whatever would.
    """
    nv = track.model.nv
    scale = np.repeat([1.0, track.period], nv)
    push = linear.advance[:, : 2 * nv, linear.advance.shape[1] :] * scale[:, None]
    if track.long and sticks:
        moved = np.linalg.norm(push, axis=1)
        push[np.broadcast_to((moved < NOTHING * np.median(moved, 0))[:, None], push.shape)] = 0.0
    return np.linalg.pinv(push, rcond=1e-9) * scale


def _ahead(slopes: Slopes, change: Change) -> np.ndarray:
    return np.einsum("kij,kj->ki", slopes.advance[:, :, slopes.advance.shape[1] :], change.force)


def _read(slopes: Slopes, change: Change) -> np.ndarray:
    return np.einsum("kij,kj->ki", slopes.reads[:, :, slopes.advance.shape[1] :], change.force)


def _moved(response: Response, numbers, placed, index: int, doubt, sign) -> Change:
    """What a unit of the coordinate of one of the numbers does."""
    number = numbers[index]
    value = number.value * np.exp(number.nudge) if number.log else number.value + number.nudge
    changed = [replace(n, value=value) if i == index else n for i, n in enumerate(numbers)]
    own = response.states, response.tau, doubt, sign, response.plant.surprise
    plant = plant_of(response.track, placed_of(changed, placed), theta_of(changed), *own)
    return response(plant).scaled(1 / number.nudge)


def _rubbed(plant: Plant, slopes: Slopes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What dry friction does to whatever moves the next state, (N, n, n), and the derivatives with it.

    It follows the speed half a sample later, (v + v') / 2, which is implicit.
    """
    advance, reads = slopes.advance.copy(), slopes.reads.copy()
    n = advance.shape[1]
    nv = advance.shape[2] - n
    slope = plant.rubbing.slope[:, None]
    half = advance[:, :, n:] * slope / 2
    rubbed: np.ndarray = np.tile(np.eye(n), (len(advance), 1, 1))
    rubbed[:, :, nv : 2 * nv] -= half
    rubbed = np.linalg.inv(rubbed)
    advance[:, :, nv : 2 * nv] += half
    reads[:, :, nv : 2 * nv] += reads[:, :, n:] * slope
    return rubbed, rubbed @ advance, reads


def _starts(plant: Plant, states: States) -> tuple[np.ndarray, np.ndarray]:
    """From each run's first state to what is believed of it, and how far that is to be believed, (runs, n) each."""
    track = plant.track
    nv, rows = track.model.nv, track.bounds[:-1]
    qvel = np.sqrt(np.mean(states.qvel**2, 0)) + 1e-3
    begun, rotors = starts_of_rotors(track, states, plant.rotors, plant.driven)
    wide = np.concatenate([WIDE * qvel * track.period * 10 + 1e-3, WIDE * qvel, WIDE * np.ones(track.model.na), rotors])
    first, spread = np.zeros((len(rows), states.size)), np.tile(wide, (len(rows), 1))
    first[:, 2 * nv + track.model.na :] = begun
    known = np.isfinite(track.recording.start_sd)
    for i, run in enumerate(track.runs):
        if run.qpos is not None and run.qvel is not None and run.opens and known.any():
            own = states[rows[i] : rows[i] + 1]
            believed = States(run.qpos[None], run.qvel[None], own.act)
            first[i, : 2 * nv][known] = track.space.minus(believed, own)[0, : 2 * nv][known]
            spread[i, : 2 * nv][known] = track.recording.start_sd[known]
    return first, spread
