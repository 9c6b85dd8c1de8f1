"""The whole experiment as one sparse nonlinear programme, with sensitivities as variables.

Variables are the design, the information gathered, and for every step: states, contact forces and slacks after it, and
the derivatives of all of these in the relative parameters. Constraints are every step's equations, their derivatives
(so that the sensitivities are exact where the programme is solved) and the sum of information. Derivatives of all
steps are one small function mapped over the horizon, put together as sparse matrices: CasADi's own colouring of the
whole would take hundreds of sweeps.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse

from fimpact.paper.contact_implicit.simulate import Motion
from fimpact.paper.contact_implicit.step import Step

WORTH = 1e-4  # information is carried in units of 1 / WORTH: contact gives some 1e4 to 1e8
NONE = 1e-4  # keeps the logarithm finite: one unit of information
SHORT = {"cse": True}  # what an expression computes twice it computes once
STEEP = 100.0  # sensitivities are carried in units of STEEP, by which they exceed what they are derivatives of


@dataclass(frozen=True)
class Affine:
    """What a design (d,) sets, as `launch` says it: the start (nx,) and the controls (N, nu), both affine in it."""

    start: np.ndarray
    start_slope: np.ndarray
    controls: np.ndarray
    controls_slope: np.ndarray


class Transcription:
    """The programme of `count` steps: `functions` for a solver, and the way between motions and variables.

    Variables: design scaled to [-1, 1] (d,), information (1,), then per step (nx + nf) (1 + p) numbers.
    Parameters: rho (p,), eps, and the units (p, p), by columns, in which rho is counted.
    """

    def __init__(self, step: Step, affine: Affine, middle: np.ndarray, half: np.ndarray, count: int):
        self.step, self.count, self.middle, self.half = step, count, middle, half
        self.designs, self.node = len(middle), (step.states + step.forces) * (1 + step.parameters)
        self.size = self.designs + 1 + count * self.node
        self.problem, self.options = self._assemble(affine)

    def pack(self, design: np.ndarray, motion: Motion) -> np.ndarray:
        """The variables that say `design` and its `motion`."""
        slopes = motion.slope.transpose(0, 2, 1).reshape(self.count, -1) / STEEP
        gathered = motion.information * WORTH
        nodes = np.hstack([motion.after, slopes])
        return np.concatenate([(design - self.middle) / self.half, [gathered], nodes.ravel()])

    def design(self, variables: np.ndarray) -> np.ndarray:
        """The design among the variables."""
        return self.middle + self.half * np.clip(variables[: self.designs], -1, 1)

    def information(self, variables: np.ndarray) -> float:
        """Trace of the Fisher information among the variables."""
        return float(variables[self.designs]) / WORTH

    def _assemble(self, affine: Affine) -> tuple[dict, dict]:
        """The programme for `nlpsol`, and its own Jacobian and Hessian."""
        local, (place, offset) = _local(self.step), self._places(affine)
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.step.parameters * (self.step.parameters + 1) + 1)
        own = ca.reshape(place @ x + offset, -1, self.count)
        settings = ca.repmat(p, 1, self.count)
        total, unit = x[self.designs], ca.DM.triplet([self.designs], [0], [1.0], self.size, 1)
        equations, gathered = local["value"].map(self.count)(own, settings)
        constraints = ca.vertcat(ca.vec(equations), total - ca.sum2(gathered))
        slopes, gains = local["slope"].map(self.count)(own, settings)
        slope = ca.vertcat(_blocks(slopes, self.count) @ place, unit.T - ca.vec(gains).T @ place)
        scale, weights = ca.MX.sym("scale"), ca.MX.sym("weights", constraints.numel())
        of_steps = ca.reshape(weights[:-1], -1, self.count), ca.repmat(-weights[-1], 1, self.count)
        curve = place.T @ _blocks(local["curve"].map(self.count)(own, settings, *of_steps), self.count) @ place
        curve += scale / (total + NONE) ** 2 * unit @ unit.T
        programme = {"x": x, "p": p, "f": -ca.log(total + NONE), "g": constraints}
        return programme, {
            "jac_g": ca.Function("jac_g", [x, p], [constraints, slope]),
            "hess_lag": ca.Function("hess_lag", [x, p, scale, weights], [ca.triu(curve)]),
        }

    def _places(self, affine: Affine) -> tuple[ca.DM, ca.DM]:
        """Matrix and offset that pick every step's own variables, one step after another, out of all variables."""
        s, first = self.step, self.designs + 1
        wide, own = s.states + s.forces, s.states * (1 + s.parameters) + self.node + s.controls
        place = sparse.lil_array((self.count * own, self.size))
        offset = np.zeros((self.count, own))
        # Of the node before, the states and their sensitivities, without those of the forces.
        kept = np.r_[0 : s.states, wide : self.node]
        kept = kept[(kept - wide) % wide < s.states]
        for k in range(self.count):
            row, node = k * own, first + k * self.node
            if k:
                place[row + np.arange(len(kept)), node - self.node + kept] = 1
            here = np.arange(self.node)
            place[row + len(kept) + here, node + here] = 1
            place[row + own - s.controls : row + own, : self.designs] = affine.controls_slope[k] * self.half
            offset[k, own - s.controls :] = affine.controls[k] + affine.controls_slope[k] @ self.middle
        place[: s.states, : self.designs] = affine.start_slope * self.half
        offset[0, : s.states] = affine.start + affine.start_slope @ self.middle
        return ca.DM(sparse.csc_matrix(place)), ca.DM(offset.ravel())


def _local(step: Step) -> dict[str, ca.Function]:
    """Equations and information of one step, their Jacobians and the Lagrangian's Hessian, of its own variables.

    Those are the states before and their sensitivities, the node after it, and the controls.
    """
    wide = step.states + step.forces
    sizes = [step.states, step.states * step.parameters, wide, wide * step.parameters, step.controls]
    own, settings = ca.SX.sym("own", sum(sizes)), ca.SX.sym("settings", step.parameters * (step.parameters + 1) + 1)
    rho, eps, units = ca.vertsplit(settings, [0, step.parameters, step.parameters + 1, settings.numel()])
    before, carried, after, slope, control = ca.vertsplit(own, np.cumsum([0, *sizes]).tolist())
    carried, slope = (ca.reshape(part, -1, step.parameters) * STEEP for part in (carried, slope))
    equations = step.residual(after, before, control, rho, eps)
    # Total derivatives in rho: what the step ends in and what it begins with move, and so does rho itself.
    units = ca.reshape(units, step.parameters, step.parameters)
    moving, ways = ca.vertcat(after, before, rho), ca.vertcat(slope, carried, units)
    steady = ca.jtimes(equations, moving, ways)
    gathered = ca.sumsqr(ca.jtimes(step.measure(after, before, rho), moving, ways)) * WORTH
    equations = ca.vertcat(equations, ca.vec(steady) / STEEP)
    weight, worth = ca.SX.sym("weight", equations.numel()), ca.SX.sym("worth")
    curve = ca.hessian(ca.dot(weight, equations) + worth * gathered, own)[0]
    slopes = [ca.jacobian(equations, own), ca.densify(ca.gradient(gathered, own))]
    return {
        "value": ca.Function("value", [own, settings], [equations, gathered]),
        "slope": ca.Function("slope", [own, settings], slopes, SHORT),
        "curve": ca.Function("curve", [own, settings, weight, worth], [curve], SHORT),
    }


def _blocks(mapped: ca.MX, count: int) -> ca.MX:
    """Matrices side by side, as `map` returns them, as one block-diagonal matrix."""
    return ca.diagcat(*ca.horzsplit(mapped, mapped.shape[1] // count))
