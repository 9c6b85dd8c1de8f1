"""Sensitivities through contact, Fisher information, its scalar criteria, and what they leave invisible.

All statistics are in relative parameters rho = theta / nominal, so that a metre and a kilogram compare.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from fimpact.paper.mjx.engine import mjx

import jax
import numpy as np

from fimpact.paper.information.rollout import rollout
from fimpact.paper.systems.base import System


class Linearisation(NamedTuple):
    """Whitened measurement (T * ny,) and its sensitivity S (T * ny, p)."""

    measurement: jax.Array
    sensitivity: jax.Array


def linearise(system: System, model: mjx.Model, rho: jax.Array, design: jax.Array) -> Linearisation:
    """Prediction and its derivatives in the relative parameters, in one forward-mode pass through contact."""

    def whitened(rho: jax.Array) -> tuple:
        measurement = rollout(system, model, rho * system.nominal, design).ravel() / system.sensor.noise
        return measurement, measurement

    sensitivity, measurement = jax.jacfwd(whitened, has_aux=True)(rho)
    return Linearisation(measurement, sensitivity)


def fisher(sensitivity: jax.Array) -> jax.Array:
    """Fisher information S'S, (p, p): the expectation over the noise of the empirical sum of xi xi'."""
    return sensitivity.T @ sensitivity


def score(sensitivity: jax.Array, residual: jax.Array) -> jax.Array:
    """xi_i = grad log p(y_i | ...) for every measurement, (T * ny, p), from whitened residuals (T * ny,)."""
    return sensitivity * residual[:, None]


def empirical_information(sensitivity: jax.Array, residual: jax.Array) -> jax.Array:
    """The paper's empirical Fisher information, the sum over i of xi_i xi_i', (p, p)."""
    xi = score(sensitivity, residual)
    return xi.T @ xi


CRITERIA: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "trace": lambda information: np.log(np.trace(information, axis1=-2, axis2=-1)),  # the paper's
    "A": lambda information: -np.log((1 / np.linalg.eigvalsh(information)).sum(-1)),  # mean squared error
    "D": lambda information: np.linalg.slogdet(information)[1],  # volume of the confidence ellipsoid
    "E": lambda information: np.log(np.linalg.eigvalsh(information)[..., 0]),  # worst direction
}
"""Scalars of positive definite information matrices (..., p, p); a design maximises one of them."""


@dataclass(frozen=True)
class Identifiability:
    """Eigenvalues (p,) in rising order, unit directions (p, p) by row, and the verdict in words."""

    eigenvalues: np.ndarray
    directions: np.ndarray
    standard_errors: np.ndarray
    verdict: tuple[str, ...]


def identifiability(information: np.ndarray, names: tuple[str, ...], prior_sd: float) -> Identifiability:
    """Which parameters an experiment shows; a direction is visible when it beats the prior tenfold.

    Args:
        information: Fisher information in relative parameters, (p, p), without the prior.
        prior_sd: relative standard deviation of the prior.
    """
    values, vectors = np.linalg.eigh(information)
    precision = information + np.eye(len(names)) / prior_sd**2
    errors = np.sqrt(np.diag(np.linalg.inv(precision)))
    words = tuple(_in_words(value, vector, names, prior_sd) for value, vector in zip(values, vectors.T, strict=True))
    return Identifiability(values, vectors.T, errors, words)


def _in_words(value: float, vector: np.ndarray, names: tuple[str, ...], prior_sd: float) -> str:
    parts = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > 0.3]
    mix = " ".join(f"{vector[i]:+.2f} {names[i]}" for i in parts)
    if value * prior_sd**2 < 1e-9:
        return f"{mix}: not visible at all"
    deviation = 100 / np.sqrt(value)
    weak = "" if value * prior_sd**2 > 100 else ", hardly more than the prior knows"
    return f"{mix}: known to {deviation:.2g} %{weak}"
