"""How far an experiment that nobody has played would drive two explanations apart.

The non-centrality is what is left of the difference of their predictions when the start and the unknowns have absorbed
what they can, in sd of the noise and of what the missing force of the recordings would do to the readings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.linalg import block_diag

from fimpact.effects.base import Effect, Placed
from fimpact.effects.law_inputs import State
from fimpact.simulation.hypothesis import Hypothesis
from fimpact.simulation.simulator import Simulator
from fimpact.simulation.windows import Windows
from fimpact.smoothing.parameters import parameters
from fimpact.smoothing.states import States, tangent

DRAWS = 4  # of the missing force
NUDGE = 1e-5  # of a start: m, rad and their rates
PIECES, MOST = 12, 9.0  # of a run, and non-centrality that one of them may be counted for
REWEIGHTED = 3  # times that pieces are weighted down
OPEN = 1e-12  # added to scaled information, so that a direction without any can be solved for


@dataclass(frozen=True)
class PriorKnowledge:
    """What is known before an experiment.

    members: the explanations. noise: sd of the readings, (ny,). force: sd of the missing force in a sample, (nv,), N or
    N m. information: of the unknowns, (p, p), in the coordinates of their `Parameter`.
    """

    simulator: Simulator
    members: tuple[Hypothesis, ...]
    noise: np.ndarray
    force: np.ndarray
    information: np.ndarray


def separations(known: PriorKnowledge, ctrl: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Predict the non-centrality of each pair of members for each of n experiments, (n, pairs); 0 where one diverges.

    Args:
        ctrl: (n, T, nu). qpos: (n, nq). qvel: (n, nv).
    """
    played = Played(known, ctrl, qpos, qvel)
    predicted = [played.predict(member) for member in known.members]
    pushed = played.pushed(predicted[0])
    scale = np.sqrt(known.noise**2 + (pushed**2).mean(1))
    columns, information = played.columns(predicted[0], pushed)
    columns = (columns / scale[:, None]).reshape(len(ctrl), len(information), -1)
    found = []
    for one, other in combinations(predicted, 2):
        found.append(non_absorbed(((one - other) / scale).reshape(len(ctrl), -1), columns, information))
    return np.where(np.isfinite(found), found, 0.0).T


class Played:
    """n experiments in simulation, a whole run each."""

    def __init__(self, known: PriorKnowledge, ctrl: np.ndarray, qpos: np.ndarray, qvel: np.ndarray):
        self.known, self.model = known, known.simulator.base
        self.states = States(qpos, qvel, _activations(self.model, ctrl))
        count, samples = ctrl.shape[:2]
        nothing = np.zeros((count, samples, len(known.noise)))
        self.windows = Windows(np.arange(count), np.zeros(count, int), nothing, ctrl, ())

    def predict(self, hypothesis: Hypothesis, states: States | None = None, repeat: int = 1) -> np.ndarray:
        """Predict readings, (n * repeat, T, ny), from `states`, default: those of the experiments."""
        own = self.states if states is None else states
        windows = self.windows.part(np.repeat(np.arange(len(self.windows.runs)), repeat))
        return self.known.simulator.predict(hypothesis, windows, own.qpos, own.qvel, own.act)

    def pushed(self, base: np.ndarray) -> np.ndarray:
        """What draws of the missing force change in the first member's readings `base`, (n, draws, T, ny)."""
        if not self.known.force.any():
            return np.zeros((len(base), 1, *base.shape[1:]))
        first, period = self.known.members[0], self.known.simulator.recording.period
        other = Hypothesis(first.theta, (*first.placed, _pushing(self.known.force, base.shape[1], period)))
        rows = np.repeat(np.arange(len(base)), DRAWS)
        return (self.predict(other, self.states[rows], DRAWS) - base[rows]).reshape(len(base), DRAWS, *base.shape[1:])

    def columns(self, base: np.ndarray, pushed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the readings, (n, c, T, ny), to start, missing force and unknowns, and what is known of
        those, (c, c): what a force does in one sample it does in the next, so that widening the noise is not all."""
        starts, told = self._starts(base)
        own = self.known.information
        unknowns = [self._unknown(base, i)[:, None] for i in range(len(own))]
        told = np.concatenate([told, np.full(pushed.shape[1], float(pushed.shape[1]))])
        return np.concatenate([starts, pushed, *unknowns], 1), block_diag(np.diag(told), own)

    def _starts(self, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        space, sd = tangent(self.model), self.known.simulator.recording.start_sd
        size, count = 2 * space.nv, len(base)
        moves = np.zeros((size, self.states.size))
        moves[:, :size] = NUDGE * np.eye(size)
        near = space.plus(self.states[np.repeat(np.arange(count), size)], np.tile(moves, (count, 1)))
        found = self.predict(self.known.members[0], near, size).reshape(count, size, *base.shape[1:])
        told = np.where(np.isfinite(sd), np.where(sd > 0, sd, 1.0), np.inf) ** -2.0
        return (found - base[:, None]) / NUDGE, told

    def _unknown(self, base: np.ndarray, index: int) -> np.ndarray:
        first, simulator = self.known.members[0], self.known.simulator
        number = parameters(simulator, first.theta, (), ())[index]
        theta = first.theta.copy()
        theta[index] = number.moved(number.nudge).value
        return (self.predict(Hypothesis(theta, first.placed)) - base) / number.nudge


def _activations(model, ctrl: np.ndarray) -> np.ndarray:
    """States of actuators, (n, na), as the first commands have them."""
    act = np.zeros((len(ctrl), model.na))
    for motor in range(model.nu):
        if model.actuator_actnum[motor] == 1:
            act[:, model.actuator_actadr[motor]] = ctrl[:, 0, motor]
    return act


def _pushing(sd: np.ndarray, samples: int, period: float) -> Placed:
    """A random force of `sd`, (nv,), held for a sample each, other ones in each of `DRAWS` neighbouring simulations."""
    drawn = np.random.default_rng(0).standard_normal((DRAWS, samples, len(sd))) * sd

    def law(state: State, site: str) -> np.ndarray:
        at = np.clip((state.time / period + 1e-6).astype(int), 0, samples - 1)
        return drawn[np.arange(len(at)) % DRAWS, at]

    effect = Effect("pushing", "remainder", "", "", "", "force", (), lambda m, c: [], lambda s, m, k: [], law, {})
    return Placed(effect, "all", {})


def non_absorbed(difference: np.ndarray, columns: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Sum the squares of `difference` (n, m), (n,), that are left when `columns` (n, c, m) absorb what `information`
    allows.

    No piece of a run counts for more than `MOST`: a wild motion magnifies a difference, and with it all that hides it.
    """
    usable = np.isfinite(columns).all((1, 2)) & np.isfinite(difference).all(1)
    columns, difference = np.where(usable[:, None, None], columns, 0.0), np.where(usable[:, None], difference, 0.0)
    weight, edges = np.ones_like(difference), np.arange(PIECES) * difference.shape[1] // PIECES
    sizes = np.diff(np.append(edges, difference.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(REWEIGHTED):
            step = _absorbed(difference, columns, information, weight)
            pieces = np.add.reduceat((difference - np.einsum("na,nam->nm", step, columns)) ** 2, edges, 1)
            weight = np.repeat(1 / np.maximum(pieces / MOST, 1.0), sizes, 1)
        left = np.minimum(pieces, MOST).sum(1) + np.einsum("na,ab,nb->n", step, information, step)
    return np.where(usable, left, 0.0)


def _absorbed(difference: np.ndarray, columns: np.ndarray, information: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Coordinates of the columns, (n, c), that explain most of a difference, weighted."""
    weighted = columns * weight[:, None]
    gram, right = weighted @ columns.swapaxes(1, 2) + information, (weighted @ difference[..., None])[..., 0]
    size = np.sqrt(np.maximum(np.einsum("naa->na", gram), 1e-300))
    scaled = gram / (size[:, :, None] * size[:, None]) + OPEN * np.eye(gram.shape[1])
    return np.linalg.solve(scaled, (right / size)[..., None])[..., 0] / size


def unknown_information(simulator: Simulator, theta: np.ndarray) -> np.ndarray:
    """What is known of the unknowns where no fit says more: their priors, (p, p)."""
    numbers = parameters(simulator, theta, (), ())
    return np.diag([number.spread**-2 for number in numbers]).reshape(len(numbers), len(numbers))


def fitted_information(information: np.ndarray, places: Sequence[int]) -> np.ndarray:
    """The information on the unknowns, place -1 of `places` (p,), that is left once effects have absorbed theirs."""
    own = np.array([place < 0 for place in places], bool)
    inner, cross, rest = information[np.ix_(own, own)], information[np.ix_(own, ~own)], information[np.ix_(~own, ~own)]
    return inner - cross @ np.linalg.pinv(rest, hermitian=True) @ cross.T
