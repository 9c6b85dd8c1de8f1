"""One step of time-stepping with relaxed complementarity, and the sensitivities that go with it.

Discretised as MuJoCo does (semi-implicit Euler, everything explicit but contact), so that without contact both agree:

    q' = q + h v'          M(q) (v' - v) = h (u - b(q, v) + Jn' n + Jt' (a - b))
    gap(q') n = eps        (mu n - a - b) s = eps        (s + slip) a = eps        (s - slip) b = eps

with normal force n, tangential forces a and b, slack s (the sliding speed) and slip Jt v'; all factors are positive.
Every product is eps, not merely at most eps: one motion then belongs to one experiment and one theta, and has exact
sensitivities. The products are written as a smooth Fischer-Burmeister function, which keeps the signs without bounds.
"""

from dataclasses import dataclass

import casadi as ca

from fimpact.paper.contact_implicit.bodies import Planar
from fimpact.paper.systems.base import System

GAP, FORCE = 0.1, 10.0  # m and N; units in which a gap and a normal force are of the same size


@dataclass(frozen=True)
class Step:
    """Functions of one step, and sizes.

    residual: (next, state, control, rho, eps) -> (nx + nf,), with `next` = (q', v', n, a, b, s).
    measure: (next, state, rho) -> the sensor's reading in standard deviations of its noise, (ny,).
    products: (next, state, rho) -> the four complementarity products of every contact, (4 nc,).
    """

    residual: ca.Function
    measure: ca.Function
    products: ca.Function
    states: int
    forces: int
    controls: int
    parameters: int


def step(system: System, planar: Planar, length: float, controls: int) -> Step:
    """The step of `length` s."""
    n, c = planar.dofs, planar.contacts
    after, before = ca.SX.sym("after", 2 * n + 4 * c), ca.SX.sym("before", 2 * n)
    control, rho = ca.SX.sym("control", controls), ca.SX.sym("rho", len(system.nominal))
    eps, theta = ca.SX.sym("eps"), rho * ca.DM(system.nominal)
    q, v = before[:n], before[n:]
    later, fast = after[:n], after[n : 2 * n]
    normal, ahead, back, slack = ca.vertsplit(after[2 * n :], c)
    here, there = planar.terms(q, v, theta), planar.terms(later, fast, theta)
    push = here.force + (control if controls else 0)
    push += here.normal.T @ normal + here.tangent.T @ (ahead - back)
    slip = here.tangent @ fast
    pairs = (
        (there.gap / GAP, normal / FORCE, GAP * FORCE),
        (planar.friction * normal - ahead - back, slack, 1.0),
        (slack + slip, ahead, 1.0),
        (slack - slip, back, 1.0),
    )
    zero = ca.vertcat(
        later - q - length * fast,
        here.mass @ (fast - v) / length - push,
        *(_both_positive(one, other, eps / unit) for one, other, unit in pairs),
    )
    reading = planar.sense(q, (fast - v) / length, normal, ahead - back) / system.sensor.noise
    products = ca.vertcat(*(one * other * unit for one, other, unit in pairs))
    return Step(
        ca.Function("residual", [after, before, control, rho, eps], [zero]),
        ca.Function("measure", [after, before, rho], [reading]),
        ca.Function("products", [after, before, rho], [products]),
        2 * n,
        4 * c,
        controls,
        len(system.nominal),
    )


def _both_positive(one: ca.SX, other: ca.SX, product: ca.SX) -> ca.SX:
    """Zero where both are positive and their product is `product`."""
    return one + other - ca.sqrt(one**2 + other**2 + 2 * product)
