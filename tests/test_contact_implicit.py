"""Direct transcription: its robot is MuJoCo's, its contact complementary, its sensitivities exact, its plan a contact."""

import casadi as ca
import mujoco
import numpy as np
import pytest
from conftest import CLEAR, TOUCHING

from fimpact import truth
from fimpact.contact_implicit.bodies import PLANAR
from fimpact.contact_implicit.plan import planner

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
    surface = data.geom_xpos[data.contact[0].geom[0]]
    for i in range(data.ncon):
        body, ball = model.geom_bodyid[data.contact[i].geom[1]], data.geom_xpos[data.contact[i].geom[1]]
        point = ball - frame * model.geom_size[data.contact[i].geom[1], 0]
        jacobian = np.zeros((3, 3))
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        assert np.allclose(tangent[i], jacobian[0], rtol=0, atol=1e-9)
        assert np.allclose(normal[i], frame @ jacobian, rtol=0, atol=1e-9)
    assert np.isfinite(surface).all()


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
    _, products = exact.judge(TOUCHING[system.name], motion.after, robot(system))
    assert motion.solved and np.allclose(products, eps, rtol=1e-3)
    normal, ahead, back, slack = np.split(motion.after[:, 6:], 4, axis=1)
    assert min(part.min() for part in (normal, ahead, back, slack)) > 0
    assert (ahead + back <= system.settings["contact"]["friction"] * normal).all()


def test_the_rigid_impulse_is_near_mujocos(systems):
    # The arm's soft wall is critically damped: it does not throw back either.
    arm = systems["arm"]
    planned = planner(arm, arm.steps).simulate(TOUCHING["arm"], np.ones(6), 1e-6).reading * arm.sensor.noise
    measured, _ = truth.simulate(arm, arm.nominal, TOUCHING["arm"])
    assert np.allclose(planned.sum(0), measured.sum(0), rtol=0.1, atol=3.0)


def test_sensitivities_are_the_slopes_of_the_readings(system, exact):
    rho, eps, size = robot(system), 1e-3, 1e-6
    motion = exact.simulate(TOUCHING[system.name], rho, eps)
    for i, move in enumerate(size * np.eye(len(rho))):
        ahead, back = (exact.simulate(TOUCHING[system.name], rho + way, eps).reading for way in (move, -move))
        assert np.allclose((ahead - back) / (2 * size), motion.sensitivity[..., i], rtol=1e-4, atol=2e-2)


def test_the_programmes_derivatives_are_those_of_finite_differences(system):
    """Of the Fisher trace, and of what binds it to the design: a step along any variable, Jacobian and Hessian."""
    made = planner(system, 10)
    programme, rho, rng = made.programme, robot(system), np.random.default_rng(3)
    x = programme.pack(TOUCHING[system.name], made.simulate(TOUCHING[system.name], rho, 1e-2))
    x = x + 1e-3 * rng.standard_normal(len(x))
    p, weights = np.append(rho, 1e-2), rng.standard_normal(programme.problem["g"].numel())
    slope, curve = programme.options["jac_g"], programme.options["hess_lag"]
    cost = ca.Function("cost", [programme.problem["x"], programme.problem["p"]], [programme.problem["f"]])
    way = rng.standard_normal(len(x)) * (rng.random(len(x)) < 0.2)
    way /= np.linalg.norm(way)

    def lagrangian_slope(at: np.ndarray) -> np.ndarray:
        first = np.array(ca.jacobian(programme.problem["f"], programme.problem["x"]).sparsity().nnz() and _slope(at))
        return first + np.array(slope(at, p)[1].T @ weights)[:, 0]

    gradient = ca.Function(
        "gradient",
        [programme.problem["x"], programme.problem["p"]],
        [ca.densify(ca.gradient(programme.problem["f"], programme.problem["x"]))],
    )

    def _slope(at: np.ndarray) -> np.ndarray:
        return np.array(gradient(at, p))[:, 0]

    size = 1e-6
    ahead, back = (np.array(slope(x + sign * size * way, p)[0])[:, 0] for sign in (1, -1))
    exact = np.array(slope(x, p)[1] @ way)[:, 0]
    assert np.allclose((ahead - back) / (2 * size), exact, rtol=1e-4, atol=1e-4 * np.abs(exact).max())
    upper = ca.triu2symm(curve(x, p, 1.0, weights))
    exact = np.array(upper @ way)[:, 0]
    change = (lagrangian_slope(x + size * way) - lagrangian_slope(x - size * way)) / (2 * size)
    assert np.allclose(change, exact, rtol=1e-3, atol=1e-4 * np.abs(exact).max())
    assert np.isfinite(float(cost(x, p)))


def test_the_trace_is_the_motions_and_its_slope_in_the_design_is_exact(system):
    """What IPOPT climbs, the Fisher trace over designs, against a finite difference of simulated motions."""
    made, rho, eps, size = planner(system, 20), robot(system), 1e-2, 1e-6
    design = TOUCHING[system.name]
    motion = made.simulate(design, rho, eps)
    assert made.programme.information(made.programme.pack(design, motion)) == pytest.approx(motion.information)
    programme, x = made.programme, made.programme.pack(design, motion)
    jacobian = np.array(ca.densify(programme.options["jac_g"](x, np.append(rho, eps))[1]))
    d = programme.designs
    total = np.linalg.solve(jacobian[:, d:], -jacobian[:, :d])[0]  # implicit function theorem: d(trace)/d(design)
    way = np.random.default_rng(4).standard_normal(d)
    ahead, back = (
        made.programme.pack(at, made.simulate(at, rho, eps))[d]
        for at in (design + sign * size * way * programme.half for sign in (1, -1))
    )
    assert (ahead - back) / (2 * size) == pytest.approx(total @ way, rel=1e-3)


def test_contact_is_found_from_a_start_that_has_none(system):
    start, rho = CLEAR[system.name], np.ones(len(system.nominal))
    assert truth.simulate(system, system.nominal, start)[1] == 0
    made = planner(system, system.steps // 2)
    plan = made.plan(rho, start, EPS, 60)
    low, high = system.inputs.bounds
    assert truth.simulate(system, system.nominal, plan.design)[1] > 0
    assert plan.solved and plan.residual < 1e-4
    assert (plan.design >= low).all() and (plan.design <= high).all()
    assert plan.information > 1e3 * max(made.simulate(start, rho, EPS[-1]).information, 1)
    again = made.plan(rho, start, EPS, 60)
    assert np.array_equal(plan.design, again.design) and np.array_equal(plan.after, again.after)


def test_a_stage_that_ran_out_gathers_no_less_than_its_start(system):
    rho, start = np.ones(len(system.nominal)), TOUCHING[system.name]
    made = planner(system, 20)
    plan = made.plan(rho, start, [1e-2], 2)
    assert not plan.solved
    assert plan.information >= made.simulate(start, rho, 1e-2).information - 1e-6
    assert plan.residual == pytest.approx(1e-2, rel=1e-3)
