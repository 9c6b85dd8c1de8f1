"""What an effect is: one piece of physics that a model may lack, where it can sit and how it enters.

An effect enters a simulation in one of six ways, and `Effect.enters` says which function it is:

- ``model``:   ``f(model, site, **values)`` edits the fields of a MuJoCo model in place (the native way).
- ``force``:   ``f(state, site, **values)`` returns a generalised force, shape (n, nv), N or N m.
- ``friction``: ``f(state, site, **values)`` returns the largest dry friction at positive and at negative speed of joint
  `site`, (n,) each, N or N m; MuJoCo holds and slides the joint within them.
- ``gear``: ``f(shaft, site, **values)`` returns what a gear that gives does between motor and link of joint `site`, and
  how far the motor is ahead (`fimpact.effects.gears`).
- ``command``: ``f(ctrl, signal, site, **values)`` returns the commands that reach the plant, (runs, T, nu).
- ``measurement``: ``f(measured, signal, site, **values)`` returns what the sensors report, (n, T, ny), at
  the times of `signal`: those of samples, or without actuators those of simulation steps.

`values` are the effect's parameters by name. At its neutral values an effect changes nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

ENTERS = ("model", "force", "friction", "gear", "command", "measurement")
SMALL = 0.02  # of a natural scale of the recording: probing amplitudes
RIGID_BODIES, FRICTION, MOTOR, TRANSMISSION, SENSING, STRUCTURE, ENVIRONMENT = range(7)  # the order of suspicion
Values = dict[str, float]


@dataclass(frozen=True)
class Coefficient:
    """A parameter of an effect: unit and bounds; `shape` parameters have no meaning where the amplitude is zero; sd: of
    what instruments of the kind are off by, where anybody knows; even: as likely anywhere in its range at a site."""

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf
    shape: bool = False
    sd: float = np.inf
    even: bool = False


@dataclass(frozen=True)
class Scales:
    """Typical magnitudes in the recording at hand, from which probing amplitudes follow.

    force, speed, travel, middle: root mean square generalised force, speed, standard deviation and mean of position of
    each degree of freedom, (nv,) each. drive, summit: root mean square and largest force of each actuator, before its
    gear, (nu,) each; needed: the force that the motion hardly ever needed more of, 0 where nobody knows. measured:
    standard deviation of each channel, (ny,). mass: total moving mass, kg. length: size of the mechanism, m. gravity:
    m/s^2, 9.81 where the model has none. period: sampling period, s. duration: of the longest run, s.
    """

    force: np.ndarray
    speed: np.ndarray
    travel: np.ndarray
    middle: np.ndarray
    drive: np.ndarray
    summit: np.ndarray
    needed: np.ndarray
    measured: np.ndarray
    mass: float
    length: float
    gravity: float
    period: float
    duration: float


def unstated(scales: Scales, model: mujoco.MjModel, site: str) -> Values:
    """The prior of amplitudes of which no handbook says how large they are: `Effect` puts its own in its place."""
    return {}


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    sites: of (model, channels) -> names of the joints, actuators, bodies, contact pairs or channels where it can sit.
    probes: of (scales, model, site) -> values at which the effect is tried; each gives one column of the score test.
    law: the function described at the top of this module.
    export: of (spec, site, **values): write it into an MjSpec with native fields; None where MuJoCo has none, and
        then the law itself is exported as a documented Python callback.
    neutral: values at which nothing changes. family, equation, sentence, reference: for the report.
    ranges: of (scales, model, site) -> bounds of shapes there, narrower than those of the coefficient. Beyond, a shape
        says what another effect says better: a spring that is slack only many turns away is a constant torque.
    linear: the law is proportional to its amplitude parameters (all that are not `shape`), so a probe can be scaled.
    contains: names of effects that are special cases of this one.
    touching: it acts only while something touches: a property of the contact, or of the ground.
    prior: of (scales, model, site) -> standard deviation of each amplitude (all parameters that are not `shape`) there,
        as data sheets and handbooks give it; of one whose neutral value is infinite, its typical size. `unstated`:
        what the probes are small beside. prior_source: whence.
    order: place in the order in which an engineer suspects, which decides ties: RIGID_BODIES first.
    refines: names of effects of which this is a small refinement.
    least: of (scales, model, site) -> sizes of amplitudes that every rig has and no expert would call missing: what is
        no larger is told as small.
    scan: of (finest, farthest) -> values of its one coefficient that differ, between what can be told and what is
        commanded at most: for a law of commands that has no slope there.
    side_by_side: a law that remembers may be asked for several hypotheses at once: its values are (n,) each, and so is
        all that the `Shaft` of a gear holds, whatever its site; of each value, all are neutral or none is.
    shifts_time: what it reads or commands comes at another time than the log says, perhaps between two samples.
    """

    name: str
    family: str
    equation: str
    sentence: str
    reference: str
    enters: str
    coefficients: tuple[Coefficient, ...]
    sites: Callable[[mujoco.MjModel, Sequence[str]], list[str]]
    probes: Callable[[Scales, mujoco.MjModel, str], list[dict[str, float]]]
    law: Callable
    neutral: dict[str, float]
    export: Callable | None = None
    ranges: Callable[[Scales, mujoco.MjModel, str], dict[str, tuple[float, float]]] = lambda *_: {}
    linear: bool = True
    contains: tuple[str, ...] = ()
    touching: bool = False
    prior: Callable[[Scales, mujoco.MjModel, str], Values] = unstated
    prior_source: str = "the natural scale of the recording"
    order: int = ENVIRONMENT
    refines: tuple[str, ...] = ()
    least: Callable[[Scales, mujoco.MjModel, str], Values] = lambda *_: {}
    scan: Callable[[float, float], np.ndarray] | None = None
    side_by_side: bool = False
    shifts_time: bool = False

    def __post_init__(self):
        if self.prior is unstated:
            object.__setattr__(self, "prior", self._beside_probes)

    def _beside_probes(self, scales: Scales, model: mujoco.MjModel, site: str) -> Values:
        probes = self.probes(scales, model, site)
        amplitudes = [c.name for c in self.coefficients if not c.shape]
        return {name: max(abs(probe[name]) for probe in probes) / SMALL for name in amplitudes}


@dataclass(frozen=True)
class Placed:
    """An effect at a site with values: a hypothesis about what is missing. sizes, ranges, least: the largest size of
    each value in the effect's probes at the site, between what bounds it may be, and what of it every rig has; empty
    where nobody asked."""

    effect: Effect
    site: str
    values: dict[str, float]
    sizes: dict[str, float] = field(default_factory=dict)
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    least: Values = field(default_factory=dict)

    @property
    def held(self) -> list[str]:
        """Values that no probe moves, and no fit: an anchor out of the plane of a planar mechanism, say."""
        return [name for name, size in self.sizes.items() if size == 0]

    @property
    def usual(self) -> bool:
        """Whether it is no more than every rig has."""
        away = {name: abs(value - self.effect.neutral[name]) for name, value in self.values.items()}
        return bool(self.least) and all(away[name] <= size for name, size in self.least.items())

    @property
    def name(self) -> str:
        """``effect@site``, the form in which tables and answers name it."""
        return f"{self.effect.name}@{self.site}"


def words(name: str) -> str:
    """``coulomb@joint_2`` as a reader says it."""
    said = []
    for part in name.split("+"):
        effect, at, site = part.partition("@")
        said.append(f"{effect.replace('_', ' ')} at {site}" if at else effect)
    return " and ".join(said)
