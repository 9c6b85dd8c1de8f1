"""The colour that disturbances give the residual: through the sensitivities to forces its covariance is I + P K P'."""

from dataclasses import dataclass, replace

import numpy as np

from fimpact.mismatch.disturbance import Disturbance, disturbance
from fimpact.mismatch.fit import Fit
from fimpact.mismatch.problem import Linear
from fimpact.mismatch.pulses import Felt

CLOCK = 0.02  # of the sampling period: sd of a run's clock against that of its commands
PASSES = 3  # of a disturbance and the effect beside it in turn


@dataclass(frozen=True)
class Colour:
    """Orthonormal directions (w, m, c) in which the residual of a window is louder than noise by sd `louder`, (w, c),
    what a late clock of each run does to it, (w, m, runs), and the disturbance that makes it so."""

    directions: np.ndarray
    louder: np.ndarray
    clocks: np.ndarray
    pushing: Disturbance

    @property
    def noise(self) -> float:
        """What is white, in units of the noise of the sensors."""
        return self.pushing.noise

    def white(self, columns: np.ndarray) -> np.ndarray:
        """`columns`, (w, m, k), in units in which the residual is white."""
        along = self.directions.transpose(0, 2, 1) @ columns
        return (columns - self.directions @ (along * (1 - 1 / self.louder)[:, :, None])) / self.noise

    def apply(self, linear: Linear) -> Linear:
        """`linear`, which knows no colour, in those units, the clocks after its own columns."""
        raw = np.concatenate([linear.raw, self.clocks], 2)
        basis, triangle = np.linalg.qr(self.white(linear.basis @ linear.triangle))
        new = Linear(basis, triangle, raw, raw, self)
        return replace(new, projected=new.off(raw))

    def with_clocks(self, own: np.ndarray, clock: float) -> np.ndarray:
        """A value of each coordinate, (k,), and `clock` for each clock."""
        return np.append(own, np.full(self.clocks.shape[2], clock))


def colour(found: Felt, pushing: Disturbance) -> Colour:
    """What `pushing` makes of the noise in the windows of `found`."""
    directions, size, _ = np.linalg.svd(found.columns @ pushing.root(), full_matrices=False)
    return Colour(directions, np.sqrt(1 + (size / pushing.noise) ** 2), found.clocks, pushing)


def beside(fitted: Fit, found: Felt, change: np.ndarray) -> Disturbance:
    """The disturbance left by `fitted` and as much of a candidate as suits it best, which does `change`, (w, m): beside
    `fitted` alone a missing effect passes for a disturbance, in which it hides."""
    pushing = disturbance(fitted, found)
    for _ in range(PASSES):
        point = replace(fitted.point, residual=_without(fitted, colour(found, pushing), change))
        pushing = disturbance(replace(fitted, point=point), found)
    return pushing


def _without(fitted: Fit, shade: Colour, change: np.ndarray) -> np.ndarray:
    """Residual, (w, m), one generalised step away, `change` among the coordinates."""
    linear, plain = shade.apply(fitted.linear), np.concatenate([fitted.linear.raw, shade.clocks, change[..., None]], 2)
    columns = linear.off(plain)
    prior = np.append(shade.with_clocks(fitted.coordinates.sd, CLOCK), np.inf)
    scale = np.append(shade.with_clocks(fitted.scale, CLOCK), 1 / np.sqrt(max((columns[..., -1] ** 2).sum(), 1e-300)))
    hessian = np.einsum("wma,wmb->ab", columns, columns) + np.diag(prior**-2.0)
    slope = np.einsum("wma,wm->a", columns, linear.off(fitted.point.residual))
    slope -= np.append(shade.with_clocks(fitted.pull, 0.0), 0.0)
    step = scale * np.linalg.lstsq(hessian * np.outer(scale, scale), slope * scale, rcond=1e-12)[0]
    return fitted.point.residual - plain @ step


def coloured(fitted: Fit, found: Felt, pushing: Disturbance | None = None) -> Fit:
    """`fitted` with its problem in units in which disturbances, `pushing` or those that it leaves, are white noise, and
    with a clock of its own for each run as further coordinates."""
    shade = colour(found, pushing or disturbance(fitted, found))
    linear, prior = shade.apply(fitted.linear), shade.with_clocks(fitted.coordinates.sd, CLOCK)
    precision = np.einsum("wma,wmb->ab", linear.projected, linear.projected) + np.diag(prior**-2.0)
    scale, pull = shade.with_clocks(fitted.scale, CLOCK), shade.with_clocks(fitted.pull, 0.0)
    return replace(fitted, linear=linear, precision=precision, scale=scale, pull=pull)
