"""Direct transcription: MuJoCo's robot, complementary contact, exact sensitivities, and a plan that finds contact."""

from dataclasses import replace

import casadi as ca
import mujoco
import numpy as np
import pytest
from conftest import CLEAR, TOUCHING
from scipy.sparse.linalg import spsolve

from fimpact.paper import reference_simulator
from fimpact.paper.contact_implicit.bodies import PLANAR
from fimpact.paper.contact_implicit.plan import BURST, Planner, planner

EPS = [0.1, 1e-3, 1e-6]
OFF = 0.9  # the robot of these tests is so much of nominal


@pytest.fixture
def exact(system):
    """A planner in MuJoCo's own steps."""
    return planner(system, system.steps)


def robot(system) -> np.ndarray:
    return np.linspace(OFF, 2 - OFF, len(system.nominal))


def test_mass_and_force_are_mujocos(system):
    model = system.compile(robot(system) * system.nominal)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:], data.qvel[:] = rng.standard_normal(3), 3 * rng.standard_normal(3)
    mujoco.mj_forward(model, data)
    q, v, theta = ca.SX.sym("q", 3), ca.SX.sym("v", 3), ca.SX.sym("theta", len(system.nominal))
    terms = PLANAR[system.name](system).terms(q, v, theta)
    told = ca.Function("told", [q, v, theta], [terms.mass, terms.force])
    mass, force = (np.array(part) for part in told(data.qpos, data.qvel, robot(system) * system.nominal))
    # M a = f without control is how MuJoCo's unconstrained acceleration says the same.
    assert np.allclose(mass @ data.qacc_smooth, force[:, 0], rtol=0, atol=1e-9)
    for row in np.eye(3):
        out = np.zeros(3)
        mujoco.mj_mulM(model, data, out, row)
        assert np.allclose(mass @ row, out, rtol=0, atol=1e-9)


def test_gap_and_its_slopes_are_mujocos(system):
    model = system.compile(robot(system) * system.nominal)
    model.pair_margin[:] = 10.0  # every contact is listed, however far
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    data.qpos[:] = 0.3 * rng.standard_normal(3)
    mujoco.mj_forward(model, data)
    gaps = [data.contact[i].dist for i in range(data.ncon)]
    q, v, theta = ca.SX.sym("q", 3), ca.SX.sym("v", 3), ca.SX.sym("theta", len(system.nominal))
    terms = PLANAR[system.name](system).terms(q, v, theta)
    told = ca.Function("told", [q, v, theta], [terms.gap, terms.normal, terms.tangent, ca.jacobian(terms.gap, q)])
    gap, normal, tangent, slope = (np.array(p) for p in told(data.qpos, np.zeros(3), robot(system) * system.nominal))
    assert np.allclose(gap[:, 0], gaps, rtol=0, atol=1e-9)
    assert np.allclose(normal, slope, rtol=0, atol=1e-12)
    frame = data.contact[0].frame.reshape(3, 3)[0]
    for i in range(data.ncon):
        body, ball = model.geom_bodyid[data.contact[i].geom[1]], data.geom_xpos[data.contact[i].geom[1]]
        point = ball - frame * model.geom_size[data.contact[i].geom[1], 0]
        jacobian = np.zeros((3, 3))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        assert np.allclose(tangent[i], jacobian[0], rtol=0, atol=1e-9)
        assert np.allclose(normal[i], frame @ jacobian, rtol=0, atol=1e-9)


def test_without_contact_the_motion_is_mujocos(system, exact):
    rho, eps = robot(system), 1e-12
    design = np.random.default_rng(2).uniform(*system.inputs.bounds) * 0.3 + CLEAR[system.name]
    design = np.clip(design, *system.inputs.bounds)
    model = system.compile(rho * system.nominal)
    data = mujoco.MjData(model)
    qpos, qvel, ctrl = system.launch(system, design)
    data.qpos[:], data.qvel[:] = qpos, qvel
    rows, touched = [], 0
    for u in np.asarray(ctrl):
        data.ctrl[:] = u
        mujoco.mj_step(model, data)
        rows.append(np.concatenate([data.qpos, data.qvel]))
        touched += data.ncon
    motion = exact.simulate(design, rho, eps)
    assert touched == 0 and motion.solved
    assert np.abs(motion.after[:, :6] - np.array(rows)).max() < 1e-6


@pytest.mark.parametrize("eps", [1e-1, 1e-4])
def test_contact_is_complementary_within_its_cone(system, exact, eps):
    motion = exact.simulate(TOUCHING[system.name], robot(system), eps)
    products = exact.products(TOUCHING[system.name], motion.after, robot(system))
    assert motion.solved and np.allclose(products, eps, rtol=1e-3)
    normal, ahead, back, slack = np.split(motion.after[:, 6:], 4, axis=1)
    assert min(part.min() for part in (normal, ahead, back, slack)) > 0
    assert (ahead + back <= system.settings["contact"]["friction"] * normal).all()


def test_the_rigid_impulse_is_near_mujocos(systems):
    # The arm's soft wall is critically damped: it does not throw back either.
    arm = systems["arm"]
    planned = planner(arm, arm.steps).simulate(TOUCHING["arm"], np.ones(6), 1e-6).reading * arm.sensor.noise
    measured, _ = reference_simulator.simulate(arm, arm.nominal, TOUCHING["arm"])
    assert np.allclose(planned.sum(0), measured.sum(0), rtol=0.1, atol=3.0)


def test_sensitivities_are_the_slopes_of_the_readings(system, exact):
    rho, eps, size = robot(system), 1e-3, 1e-6
    motion = exact.simulate(TOUCHING[system.name], rho, eps)
    for i, move in enumerate(size * np.eye(len(rho))):
        ahead, back = (exact.simulate(TOUCHING[system.name], rho + way, eps).reading for way in (move, -move))
        assert np.allclose((ahead - back) / (2 * size), motion.sensitivity[..., i], rtol=1e-4, atol=2e-2)


def test_the_programmes_derivatives_are_those_of_finite_differences(system):
    """Jacobian and Hessian of the Lagrangian, put together from steps, along a random direction of all variables."""
    made, rho, rng, size = planner(system, 50), robot(system), np.random.default_rng(3), 1e-6
    programme, p = made.programme, np.concatenate([rho, [1e-2], np.eye(len(rho)).ravel()])
    x = programme.pack(TOUCHING[system.name], made.simulate(TOUCHING[system.name], rho, 1e-2))
    slope, curve = programme.options["jac_g"], programme.options["hess_lag"]
    symbols, cost = [programme.problem["x"], programme.problem["p"]], programme.problem["f"]
    gradient = ca.Function("gradient", symbols, [ca.densify(ca.gradient(cost, symbols[0]))])
    way, weights = rng.standard_normal(len(x)), rng.standard_normal(programme.problem["g"].numel())

    def equations(at: np.ndarray) -> np.ndarray:
        return np.array(slope(at, p)[0])[:, 0]

    def lagrangian(at: np.ndarray) -> np.ndarray:
        return np.array(gradient(at, p) + slope(at, p)[1].T @ weights)[:, 0]

    for function, exact in ((equations, slope(x, p)[1]), (lagrangian, ca.triu2symm(curve(x, p, 1.0, weights)))):
        change = (function(x + size * way) - function(x - size * way)) / (2 * size)
        exact = np.array(exact @ way)[:, 0]
        assert np.abs(change - exact).max() < 1e-4 * np.abs(exact).max()


def test_the_trace_is_the_motions_and_its_slope_in_the_design_is_exact(system):
    """What IPOPT climbs, the Fisher trace over designs, against a finite difference of simulated motions."""
    made, rho, eps, size = planner(system, 50), robot(system), 1e-2, 1e-6
    design = TOUCHING[system.name]
    motion = made.simulate(design, rho, eps)
    assert made.programme.information(made.programme.pack(design, motion)) == pytest.approx(motion.information)
    programme, x = made.programme, made.programme.pack(design, motion)
    jacobian, d = programme.options["jac_g"](x, [*rho, eps, *np.eye(len(rho)).ravel()])[1].sparse(), programme.designs
    way = np.random.default_rng(4).standard_normal(d)
    total = spsolve(jacobian[:, d:].tocsc(), -jacobian[:, :d] @ way)[0]  # by the implicit function theorem
    ahead, back = (
        made.programme.pack(at, made.simulate(at, rho, eps))[d]
        for at in (design + sign * size * way * programme.half for sign in (1, -1))
    )
    assert (ahead - back) / (2 * size) == pytest.approx(total, rel=1e-3)


def test_contact_is_found_from_a_start_that_has_none(system):
    start, rho = CLEAR[system.name], np.ones(len(system.nominal))
    assert reference_simulator.simulate(system, system.nominal, start)[1] == 0
    made = planner(system, 50)
    plan = made.plan(rho, start, EPS, 30)
    low, high = system.inputs.bounds
    assert reference_simulator.simulate(system, system.nominal, plan.design)[1] > 0
    assert plan.residual < 1e-4
    assert (plan.design >= low).all() and (plan.design <= high).all()
    assert plan.information > 1e3 * max(made.simulate(start, rho, EPS[-1]).information, 1)


def test_the_same_start_gives_the_same_bytes(system):
    made, rho = planner(system, 50), np.ones(len(system.nominal))
    first, again = (made.plan(rho, TOUCHING[system.name], [0.1, 1e-2], 4) for _ in range(2))
    assert np.array_equal(first.design, again.design) and np.array_equal(first.after, again.after)


def test_a_stage_that_ran_out_gathers_no_less_than_its_start(system):
    rho, start = np.ones(len(system.nominal)), TOUCHING[system.name]
    made = planner(system, 50)
    plan = made.plan(rho, start, [1e-2], 2)
    assert not plan.solved
    assert plan.information >= made.simulate(start, rho, 1e-2).information
    assert plan.residual == pytest.approx(1e-2, rel=1e-3)


def test_bursts_that_gain_nothing_come_nearer_and_the_last_stage_closes_in(system, monkeypatch):
    made, rho, asked = planner(system, 50), np.ones(len(system.nominal)), []

    def solve(self, start, settings, iterations, reach):
        asked.append((iterations, pytest.approx(reach)))
        return start, {"return_status": "Maximum_Iterations_Exceeded", "iter_count": iterations}

    monkeypatch.setattr(Planner, "solve", solve)
    plan = made.plan(rho, TOUCHING[system.name], [0.1, 1e-2], 2 * BURST)
    assert asked == [(BURST, reach) for reach in (2, 0.2, 2, 0.2, 0.02, 0.002)]
    assert not plan.solved and plan.iterations == 6 * BURST
    assert np.allclose(plan.designs, TOUCHING[system.name]) and len(plan.designs) == 6


def test_a_stage_ends_when_ipopt_has_converged(system, monkeypatch):
    made, rho, asked = planner(system, 50), np.ones(len(system.nominal)), []

    def solve(self, start, settings, iterations, reach):
        asked.append(reach)
        return start, {"return_status": "Solve_Succeeded", "iter_count": 1}

    monkeypatch.setattr(Planner, "solve", solve)
    assert made.plan(rho, TOUCHING[system.name], [0.1, 1e-2], 24).solved
    assert asked == [2, 2]


def test_a_burst_keeps_within_its_reach_of_the_design(system):
    made, rho = planner(system, 100), np.ones(len(system.nominal))
    start = made.programme.pack(TOUCHING[system.name], made.simulate(TOUCHING[system.name], rho, 0.1))
    settings = np.concatenate([rho, [0.1], np.eye(len(rho)).ravel()])

    def moved(reach: float) -> float:
        return np.abs(made.solve(start, settings, 6, reach)[0] - start)[: made.programme.designs].max()

    assert moved(0.02) < 0.02 + 1e-6 < moved(2.0)


@pytest.mark.parametrize(("kept", "stages"), [(0.0, [0.1, 1e-7**0.5, 1e-6]), (1.0, [0.1, 1e-6])])
def test_contact_that_rigidity_would_lose_is_tightened_half_way_first(systems, monkeypatch, kept, stages):
    """`kept`: share of the readings' sensitivities that is left at the smallest eps."""
    block = systems["block"]
    made, rho, asked = planner(block, 50), np.ones(3), []
    real = made.simulate(TOUCHING["block"], rho, 0.1)
    weak = replace(real, sensitivity=kept * real.sensitivity)
    monkeypatch.setattr(Planner, "simulate", lambda self, design, rho, eps, units=None: weak if eps < 1e-5 else real)

    def stage(self, design, motion, rho, eps, most, units):
        asked.append(eps)
        return design, motion, [design], {"return_status": "Solve_Succeeded", "iter_count": 1}

    monkeypatch.setattr(Planner, "stage", stage)
    made.plan(rho, TOUCHING["block"], [0.1, 1e-6], 24)
    assert asked == pytest.approx(stages)


def test_what_cannot_be_moved_is_not_solved(systems, monkeypatch):
    block = systems["block"]
    made, rho = planner(block, 50), np.ones(3)
    broken = replace(made.simulate(TOUCHING["block"], rho, 1e-2), solved=False)
    monkeypatch.setattr(Planner, "simulate", lambda *args: broken)
    monkeypatch.setattr(
        Planner, "solve", lambda self, start, *others: (start, {"return_status": "Solve_Succeeded", "iter_count": 1})
    )
    assert not made.plan(rho, TOUCHING["block"], [1e-2], 4).solved


def test_what_is_known_well_counts_less(system):
    """In units that leave out all parameters but one, the trace is that one's information."""
    made, rho = planner(system, 50), robot(system)
    alone = np.diag(np.arange(len(rho)) == 1).astype(float)
    all_of_them = made.simulate(TOUCHING[system.name], rho, 1e-2)
    one = made.simulate(TOUCHING[system.name], rho, 1e-2, alone)
    assert one.information == pytest.approx((all_of_them.sensitivity[..., 1] ** 2).sum())
    assert one.information < all_of_them.information
