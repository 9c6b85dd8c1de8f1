"""The truth behind a recording: what was planted, how visible it is, and everything to play the robot again."""

from dataclasses import asdict, dataclass, fields
from zlib import crc32

import numpy as np
from scipy.signal import lfilter

from fimpact.benchmark.planting.crowd import bare
from fimpact.benchmark.planting.ground_truth import Played, World, new_world, play
from fimpact.benchmark.planting.out_of_catalogue import plant
from fimpact.benchmark.planting.plant import Values
from fimpact.benchmark.rigs.registry import rig_of
from fimpact.benchmark.rigs.rig import CLOCK, Rig
from fimpact.recordings import Run

RIPPLES = 600.0  # per turn of the joint: six for each turn of the motor behind a gear of 100
SLIP = np.array([0.005, 0.02])  # how far an arm starts from where it should, rad and rad/s


@dataclass(frozen=True)
class Planted:
    """One effect at a site. lam, kappa: its non-centrality and concealment; kappa_unknown: starts projected first.
    worth: of the odd one in a crowd, its share of the force at its place."""

    name: str
    site: str
    values: Values
    lam: float
    kappa: float
    kappa_unknown: float
    mode: str
    worth: float = 0.0


@dataclass(frozen=True)
class Truth:
    """What is sealed.

    kind: single, null, double, outside, twin or crowd, whose odd effect is the last. system: the rig. effects: what was
    planted. lam, kappa,
    kappa_unknown: of all of it together. rival: the twin's other explanation, or None; cosine, left: of the two
    projected traces, and lambda of the planted one once the rival is known too. errors: (p,) of the unknowns, relative
    or in the unit of `Unknown`. start: (runs, 2 nv) true starts. offset: (runs,) of the clock, s. noise: (ny,) sd.
    disturbance, correlation: sd (N or N m on the first degree of freedom) and time, s, of the coloured disturbance.
    seed: of noise and disturbance.
    """

    kind: str
    system: str
    effects: tuple[Planted, ...]
    lam: float
    kappa: float
    kappa_unknown: float
    rival: Planted | None
    cosine: float
    left: float
    errors: tuple[float, ...]
    start: tuple[tuple[float, ...], ...]
    offset: tuple[float, ...]
    noise: tuple[float, ...]
    disturbance: float
    correlation: float
    seed: tuple[int, ...]

    @property
    def planted(self) -> str:
        """Registry names joined by ;, or none."""
        return ";".join(e.name for e in self.effects) or "none"

    @property
    def site(self) -> str:
        """Sites joined by ;, or none."""
        return ";".join(e.site for e in self.effects) or "none"

    @property
    def robot(self) -> Rig:
        """The rig as its naive model has it: in a crowd without friction and rotors."""
        rig = rig_of(self.system)
        return bare(rig) if self.kind == "crowd" else rig

    @property
    def mode(self) -> str:
        """Contact mode in which the first effect acts: free, contact, any, or none."""
        return self.effects[0].mode if self.effects else "none"


def as_json(truth: Truth) -> dict:
    """A dictionary of plain numbers, strings and lists."""
    return asdict(truth)


def from_json(table: dict) -> Truth:
    """The truth that `as_json` gave. Raises TypeError where fields are missing or unknown."""
    rival = table["rival"]
    plain = {f.name: _tuples(table[f.name]) for f in fields(Truth)}
    effects = tuple(Planted(**effect) for effect in table["effects"])
    return Truth(**(plain | {"effects": effects, "rival": Planted(**rival) if rival else None}))


def _tuples(value):
    return tuple(_tuples(v) for v in value) if isinstance(value, list) else value


def world_of(truth: Truth, coarse: Rig | None = None) -> World:
    """The planted world itself; with the coarse steps of a rig where one is given."""
    world = new_world(coarse or truth.robot, np.array(truth.errors), fine=coarse is None)
    for effect in truth.effects:
        plant(world, effect.name, effect.site, effect.values)
    return world


def disturb(rig: Rig, sd: float, correlation: float, shape: tuple[int, int], step: float, rng) -> np.ndarray:
    """Ornstein-Uhlenbeck generalised forces, (runs, N, nv), of stationary `sd` on the first degree of freedom."""
    keep = np.exp(-step / correlation)
    kicks = rng.standard_normal((*shape, rig.naive.nv)) * np.sqrt(1 - keep**2)
    kicks[:, 0] /= np.sqrt(1 - keep**2)
    return sd * rig.disturbance * lfilter([1.0], [1.0, -keep], kicks, axis=1)


def clean(truth: Truth, start: np.ndarray, ctrl: np.ndarray, offset, stream: int) -> tuple[Played, np.ndarray]:
    """The planted robot under commands (runs, T, nu), before noise, and the disturbance (runs, N, nv) it suffered."""
    rig, world = truth.robot, world_of(truth)
    rng = np.random.default_rng([*truth.seed, stream, 0])
    shape = (len(start), ctrl.shape[1] * rig.fine)
    push = disturb(rig, truth.disturbance, truth.correlation, shape, world.step, rng)
    return play(world, start, ctrl, push, np.asarray(offset)), push


def measure(truth: Truth, samples: np.ndarray, stream: int) -> np.ndarray:
    """Clean samples (runs, T, ny) as the instruments report them: with noise, and rounded."""
    rig, rng = truth.robot, np.random.default_rng([*truth.seed, stream, 1])
    noisy = samples + rig.noise * rng.standard_normal(samples.shape)
    return np.round(noisy / rig.quantum) * rig.quantum


def logged(truth: Truth, ctrl: np.ndarray, states: np.ndarray, stream: int) -> np.ndarray:
    """Commands (runs, T, nu) as the log has them: torques that motor currents tell have noise, and a ripple that goes
    round with the motor."""
    rig, rng = truth.robot, np.random.default_rng([*truth.seed, stream, 3])
    if not len(rig.current):
        return ctrl
    turned = states[:, :, [rig.naive.joint(name).qposadr[0] for name in rig.driven]]
    ripple = np.sin(RIPPLES * turned + rng.uniform(0, 2 * np.pi, len(rig.current)))
    return ctrl + rig.current * (ripple + rng.standard_normal(ctrl.shape))


def run_on_robot(
    truth: Truth, ctrl: np.ndarray, start: np.ndarray, names: tuple[str, ...], held_out: bool = False
) -> list[Run]:
    """The sealed robot told to move again, with noise, disturbance and slips at the start of its own.

    Args:
        ctrl: (runs, T, nu), held for a sample each; a thrown block has nu = 0.
        start: (runs, 2 nv), where each run is believed to start. names: of the runs.

    Returns:
        A run for each; equal commands from equal starts give equal measurements.
    """
    rig, ctrl, start = truth.robot, np.asarray(ctrl, float), np.asarray(start, float)
    stream = 1 + crc32(ctrl.tobytes() + start.tobytes())
    rng, nv = np.random.default_rng([*truth.seed, stream, 2]), rig.naive.nv
    slipped = start + slips(rig) * rng.standard_normal(start.shape)
    played, _ = clean(truth, slipped, ctrl, rng.uniform(0, CLOCK, len(ctrl)), stream)
    measured, ctrl = measure(truth, played.samples, stream), logged(truth, ctrl, played.states, stream)
    return [
        Run(name, u, y, held_out, believed[:nv], believed[nv:])
        for name, u, y, believed in zip(names, ctrl, measured, start, strict=True)
    ]


def slips(rig: Rig) -> np.ndarray:
    """Standard deviation, (2 nv,), with which a run starts elsewhere than believed."""
    return rig.start_sd if np.isfinite(rig.start_sd).all() else np.repeat(SLIP, rig.naive.nv)
