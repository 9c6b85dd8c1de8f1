"""The relaxed motion of a given experiment, step by step: a start for the transcription, and a check of it."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from fimpact.paper.contact_implicit.step import Step

NEWTON, HALVINGS = 60, 12
CLOSE = 1e-10  # residual at which a step counts as solved; forces are of the order of 1 to 100 N


@dataclass(frozen=True)
class Motion:
    """States and forces (N, nx + nf), their sensitivities in units of rho (N, nx + nf, p), whitened readings (N, ny),
    their sensitivities (N, ny, p), and whether every step was solved."""

    after: np.ndarray
    slope: np.ndarray
    reading: np.ndarray
    sensitivity: np.ndarray
    solved: bool

    @property
    def information(self) -> float:
        """Trace of the Fisher information in units of rho; less than none of a motion that could not be simulated."""
        trace = float((self.sensitivity**2).sum())
        return trace if np.isfinite(trace) and self.solved else -1.0


class Simulator:
    """Compiled once per `Step`."""

    def __init__(self, step: Step):
        self.step = step
        f, m = step.residual, step.measure
        after, before, control, rho, eps = (ca.SX.sym(f.name_in(i), f.sparsity_in(i)) for i in range(5))
        zero, reading = f(after, before, control, rho, eps), m(after, before, rho)
        parts = [ca.jacobian(zero, of) for of in (after, before, rho)]
        self._newton = ca.Function("newton", [after, before, control, rho, eps], [zero, parts[0]])
        self._slopes = ca.Function("slopes", [after, before, control, rho, eps], [ca.densify(part) for part in parts])
        parts = [ca.densify(ca.jacobian(reading, of)) for of in (after, before, rho)]
        self._reading = ca.Function("reading", [after, before, rho], [reading, *parts])

    def run(self, start: np.ndarray, controls: np.ndarray, rho: np.ndarray, eps: float, units: np.ndarray) -> Motion:
        """Simulate from `start` (nx,) under `controls` (N, nu); `units` (p, p), by columns, of rho."""
        step, rows, solved = self.step, [], True
        state, carried = start, np.zeros((step.states, step.parameters))
        guess = np.concatenate([start, np.full(step.forces, np.sqrt(eps))])
        for control in controls:
            guess, ok = self._solve(guess, state, control, rho, eps)
            solved &= ok
            over, back, by = (np.array(part) for part in self._slopes(guess, state, control, rho, eps))
            by = by @ units
            slope = -_solved(over, back @ carried + by)
            reading, over, back, by = (np.array(part) for part in self._reading(guess, state, rho))
            rows.append((guess, slope, reading[:, 0], over @ slope + back @ carried + by @ units))
            state, carried = guess[: step.states], slope[: step.states]
        after, slope, reading, sensitivity = (np.array(part) for part in zip(*rows, strict=True))
        return Motion(after, slope, reading, sensitivity, solved)

    def _solve(self, guess, state, control, rho, eps) -> tuple[np.ndarray, bool]:
        zero, jacobian = self._newton(guess, state, control, rho, eps)
        size = np.abs(np.array(zero)).max()
        for _ in range(NEWTON):
            if size < CLOSE:
                break
            move = _solved(np.array(ca.densify(jacobian)), -np.array(zero)[:, 0])
            for halving in range(HALVINGS):
                trial = guess + move / 2**halving
                zero, jacobian = self._newton(trial, state, control, rho, eps)
                if np.abs(np.array(zero)).max() < size:
                    break
            guess, size = trial, np.abs(np.array(zero)).max()
        return guess, bool(size < 1e-6)


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    # Singular to machine precision where a contact carries next to nothing and slips by next to nothing.
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.linalg.lstsq(matrix, right)[0]
