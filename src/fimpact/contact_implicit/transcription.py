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

from fimpact.contact_implicit.simulate import Motion
from fimpact.contact_implicit.step import Step

WORTH = 1e-4  # information is carried in units of 1 / WORTH: contact gives some 1e4 to 1e8
NONE = 1e-4  # keeps the logarithm finite: one unit of information
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
    Parameters: rho (p,) and eps.
    """

    def __init__(self, step: Step, affine: Affine, middle: np.ndarray, half: np.ndarray, count: int):
        self.step, self.count, self.middle, self.half = step, count, middle, half
        self.designs, self.node = len(middle), (step.states + step.forces) * (1 + step.parameters)
        self.size = self.designs + 1 + count * self.node
        self._local, self._place = self._locals(), self._places(affine)
        self.problem, self.options = self._assemble()

    def pack(self, design: np.ndarray, motion: Motion) -> np.ndarray:
        """The variables that say `design` and its `motion`."""
        slopes = motion.slope.transpose(0, 2, 1).reshape(self.count, -1) / STEEP
        gathered = (motion.sensitivity**2).sum() * WORTH
        nodes = np.hstack([motion.after, slopes])
        return np.concatenate([(design - self.middle) / self.half, [gathered], nodes.ravel()])

    def design(self, variables: np.ndarray) -> np.ndarray:
        """The design among the variables."""
        return self.middle + self.half * np.clip(variables[: self.designs], -1, 1)

    def after(self, variables: np.ndarray) -> np.ndarray:
        """States and forces after every step, (N, nx + nf)."""
        nodes = variables[self.designs + 1 :].reshape(self.count, self.node)
        return nodes[:, : self.step.states + self.step.forces]

    def information(self, variables: np.ndarray) -> float:
        """Trace of the Fisher information among the variables."""
        return float(variables[self.designs]) / WORTH

    def _locals(self) -> dict[str, ca.Function]:
        """Equations (ng,) and information of one step, their Jacobians and Hessian, of its own variables."""
        s, wide = self.step, self.step.states + self.step.forces
        own = ca.SX.sym("own", s.states * (1 + s.parameters) + self.node + s.controls)
        rho, eps = ca.SX.sym("rho", s.parameters), ca.SX.sym("eps")
        sizes = [s.states, s.states * s.parameters, wide, wide * s.parameters, s.controls]
        before, carried, after, slope, control = ca.vertsplit(own, np.cumsum([0, *sizes]).tolist())
        carried, slope = ca.reshape(carried, s.states, -1) * STEEP, ca.reshape(slope, wide, -1) * STEEP
        every, moved = ca.vertcat(after, before, rho), ca.vertcat(slope, carried, ca.SX.eye(s.parameters))
        a, b, r = ca.SX.sym("a", wide), ca.SX.sym("b", s.states), ca.SX.sym("r", s.parameters)
        zero, reading = s.residual(a, b, control, r, eps), s.measure(a, b, r)
        along = [ca.jtimes(part, ca.vertcat(a, b, r), moved) for part in (zero, reading)]
        zero, reading, steady, known = ca.substitute(
            [zero, reading, along[0], along[1]], [ca.vertcat(a, b, r)], [every]
        )
        equations, gathered = ca.vertcat(zero, ca.vec(steady) / STEEP), ca.sumsqr(known) * WORTH
        weight, worth = ca.SX.sym("weight", equations.numel()), ca.SX.sym("worth")
        curved = ca.triu(ca.hessian(ca.dot(weight, equations) + worth * gathered, own)[0])
        return {
            "value": ca.Function("value", [own, rho, eps], [equations, gathered]),
            "slope": ca.Function(
                "slope",
                [own, rho, eps],
                [equations, gathered, ca.jacobian(equations, own), ca.densify(ca.jacobian(gathered, own))],
            ),
            "curve": ca.Function("curve", [own, rho, eps, weight, worth], [curved]),
        }

    def _places(self, affine: Affine) -> tuple[ca.DM, ca.DM]:
        """Matrix and offset that pick every step's own variables, in one column, out of all variables."""
        s, first = self.step, self.designs + 1
        state, carried = s.states, s.states * s.parameters
        wide, rows, cols, values, offset = s.states + s.forces, [], [], [], []

        def pick(row: int, col: int, value: float = 1.0) -> None:
            rows.append(row), cols.append(col), values.append(value)

        for k in range(self.count):
            row, here, back = len(offset), first + k * self.node, first + (k - 1) * self.node
            offset += [0.0] * (state + carried + self.node + s.controls)
            for i in range(state):
                if k:
                    pick(row + i, back + i)
                    for j in range(s.parameters):
                        pick(row + state + j * state + i, back + wide + j * wide + i)
                else:
                    offset[row + i] = affine.start[i] + affine.start_slope[i] @ self.middle
                    for j in np.flatnonzero(affine.start_slope[i]):
                        pick(row + i, j, affine.start_slope[i, j] * self.half[j])
            for i in range(self.node):
                pick(row + state + carried + i, here + i)
            for i in range(s.controls):
                at = row + state + carried + self.node + i
                offset[at] = affine.controls[k, i] + affine.controls_slope[k, i] @ self.middle
                for j in np.flatnonzero(affine.controls_slope[k, i]):
                    pick(at, j, affine.controls_slope[k, i, j] * self.half[j])
        return ca.DM.triplet(rows, cols, values, len(offset), self.size), ca.DM(offset)

    def _assemble(self) -> tuple[dict, dict]:
        place, offset = self._place
        x, p = ca.MX.sym("x", self.size), ca.MX.sym("p", self.step.parameters + 1)
        rho, eps = p[: self.step.parameters], p[-1]
        own = ca.reshape(place @ x + offset, -1, self.count)
        every = [ca.repmat(part, 1, self.count) for part in (rho, eps)]
        total = x[self.designs]
        f = -ca.log(total + NONE)
        equations, gathered = self._local["value"].map(self.count)(own, *every)
        g = ca.vertcat(ca.vec(equations), total - ca.sum2(gathered))
        equations, gathered, slopes, gains = self._local["slope"].map(self.count)(own, *every)
        slope = ca.vertcat(
            _blocks(slopes, self._local["slope"].sparsity_out(2), self.count) @ place,
            self._unit().T - ca.vec(ca.reshape(gains, -1, self.count)).T @ place,
        )
        scale, weights = ca.MX.sym("scale"), ca.MX.sym("weights", g.numel())
        curves = self._local["curve"].map(self.count)(
            own, *every, ca.reshape(weights[:-1], -1, self.count), ca.repmat(-weights[-1], 1, self.count)
        )
        curve = place.T @ _blocks(curves, self._local["curve"].sparsity_out(0), self.count, True) @ place
        curve = ca.triu(curve + scale / (total + NONE) ** 2 * self._unit() @ self._unit().T)
        functions = {
            "jac_g": ca.Function("jac_g", [x, p], [g, slope]),
            "hess_lag": ca.Function("hess_lag", [x, p, scale, weights], [curve]),
        }
        return {"x": x, "p": p, "f": f, "g": g}, functions

    def _unit(self) -> ca.DM:
        return ca.DM.triplet([self.designs], [0], [1.0], self.size, 1)


def _blocks(mapped: ca.MX, pattern: ca.Sparsity, count: int, symmetric: bool = False) -> ca.MX:
    """The horizontally mapped matrices of one `pattern` as a block-diagonal matrix; the upper triangle is mirrored."""
    values = ca.MX(ca.Sparsity.dense(pattern.nnz() * count, 1), _nonzeros(mapped))
    whole = ca.MX(ca.diagcat(*[pattern] * count), values)
    return ca.triu2symm(whole) if symmetric else whole


def _nonzeros(matrix: ca.MX) -> ca.MX:
    return matrix.nz[:]
