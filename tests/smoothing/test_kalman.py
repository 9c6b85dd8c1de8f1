"""The filter and its adjoint against a dense least-squares solution of the same trajectory."""

from types import SimpleNamespace

import numpy as np
import pytest

from fimpact.smoothing.filter.by_run import filtered, swept, variances

N, NV, NY, SAMPLES, RUNS, COLUMNS = 4, 2, 3, 40, 2, 3
M, COUNT = N + NV, RUNS * SAMPLES


def random_problem(seed: int) -> SimpleNamespace:
    """Two runs of a random linear system that varies from sample to sample, a quarter of its readings missing."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.standard_normal((N, N)))[0]
    advance = np.concatenate([np.tile(0.97 * turn, (COUNT, 1, 1)), 0.3 * rng.standard_normal((COUNT, N, NV))], 2)
    measured = np.where(rng.random((COUNT, NY)) < 0.25, np.nan, rng.standard_normal((COUNT, NY)))
    rows = [slice(i * SAMPLES, (i + 1) * SAMPLES) for i in range(RUNS)]
    lengths = np.full(RUNS, SAMPLES)
    bounds = np.arange(RUNS + 1) * SAMPLES
    track = SimpleNamespace(measured=measured, lengths=lengths, bounds=bounds, slices=lambda: rows, count=COUNT)
    columns = 0.2 * rng.standard_normal((COUNT, NY, COLUMNS))
    columns[:, :, 0] = np.nan_to_num(measured)
    first, spread = 0.3 * rng.standard_normal((RUNS, N)), rng.uniform(0.5, 2, (RUNS, N))
    reads, offsets = rng.standard_normal((COUNT, NY, M)), 0.2 * rng.standard_normal((COUNT, N, COLUMNS))
    linear = SimpleNamespace(advance=advance, reads=reads, offsets=offsets, left=columns, first=first, spread=spread)
    return SimpleNamespace(track=track, linear=linear, pulls=0.5 * rng.standard_normal((COUNT, NV, COLUMNS)))


def levels(force=(0.3, 0.8), reading=(0.1, 0.2, 0.4)) -> SimpleNamespace:
    return SimpleNamespace(forces=np.tile(force, (COUNT, 1)), reading=np.array(reading), louder=np.ones(NY))


class Dense:
    """All of one run at once: unknown are its first state and every force, whitened rows ask for as little as possible.

    rows, ends: of the least squares in the unknowns, and of each column. z, z0: what the unknowns make of every sample,
    (K M, unknowns), and what is there without them, (K M, columns).
    """

    def __init__(self, problem: SimpleNamespace, noise: SimpleNamespace, run: int):
        rows, linear, size = problem.track.slices()[run], problem.linear, N + NV * SAMPLES
        state, at_rest = np.eye(N, size), np.zeros((N, COLUMNS))
        self.z, self.z0 = np.zeros((SAMPLES, M, size)), np.zeros((SAMPLES, M, COLUMNS))
        for k in range(SAMPLES):
            own = np.zeros((NV, size))
            own[:, N + NV * k : N + NV * (k + 1)] = np.eye(NV)
            self.z[k], self.z0[k] = np.concatenate([state, own]), np.concatenate([at_rest, np.zeros((NV, COLUMNS))])
            state = linear.advance[rows][k] @ self.z[k]
            at_rest = linear.advance[rows][k] @ self.z0[k] + linear.offsets[rows][k]
        scale = np.concatenate([linear.spread[run], noise.forces[rows].ravel()])
        mean = np.concatenate([np.zeros((N, COLUMNS)), problem.pulls[rows].reshape(-1, COLUMNS)])
        mean[:N, 0] = linear.first[run]
        known = np.isfinite(problem.track.measured[rows])
        sd, reads = np.tile(noise.reading, (SAMPLES, 1))[known][:, None], linear.reads[rows]
        left = (linear.left[rows] - reads @ self.z0)[known]
        self.rows = np.concatenate([np.diag(1 / scale), (reads @ self.z)[known] / sd])
        self.ends = np.concatenate([mean / scale[:, None], left / sd])
        self.covariance = np.linalg.inv(self.rows.T @ self.rows)
        self.values = self.covariance @ self.rows.T @ self.ends

    @property
    def states(self) -> np.ndarray:
        """Most likely z, (K, M, columns)."""
        return self.z @ self.values + self.z0

    @property
    def variances(self) -> np.ndarray:
        """Of z, (K, M)."""
        return np.einsum("kij,jl,kil->ki", self.z, self.covariance, self.z)

    @property
    def gram(self) -> np.ndarray:
        """Of what is left of the columns, (columns, columns)."""
        left = self.ends - self.rows @ self.values
        return left.T @ left


def loss(problem: SimpleNamespace, noise: SimpleNamespace) -> float:
    """Minus the logarithm of the marginal likelihood of the data's column."""
    own = filtered(problem.track, problem.linear, noise)
    innovations = swept(problem.track, problem.linear, own, problem.pulls)[0][:, :, 0]
    return float(np.log(own.sd[np.isfinite(own.sd)]).sum() + (innovations**2).sum() / 2)


@pytest.fixture(params=[0, 1])
def problem(request):
    return random_problem(request.param)


def test_smoothed_states_and_forces_are_those_of_least_squares(problem):
    noise, linear, track = levels(), problem.linear, problem.track
    own = filtered(track, linear, noise)
    innovations, mean = swept(track, linear, own, problem.pulls)
    adjoint, _ = own.adjoint(track, linear, innovations)
    states = mean[:, :N] - own.before @ own.before.swapaxes(1, 2) @ adjoint[:, :N]
    forces = mean[:, N:] - noise.forces[:, :, None] ** 2 * adjoint[:, N:]
    for run, rows in enumerate(track.slices()):
        dense = Dense(problem, noise, run)
        np.testing.assert_allclose(np.concatenate([states[rows], forces[rows]], 1), dense.states, atol=1e-9)
        flat = innovations[rows].reshape(-1, COLUMNS)
        np.testing.assert_allclose(flat.T @ flat, dense.gram, rtol=1e-9)


def test_smoothing_errors_are_what_is_left_of_each_reading(problem):
    noise, linear, track = levels(), problem.linear, problem.track
    own = filtered(track, linear, noise)
    errors = own.adjoint(track, linear, swept(track, linear, own, problem.pulls)[0])[1]
    for run, rows in enumerate(track.slices()):
        left = linear.left[rows] - linear.reads[rows] @ Dense(problem, noise, run).states
        left[~np.isfinite(track.measured[rows])] = 0.0
        np.testing.assert_allclose(errors[rows], left / noise.reading[:, None] ** 2, atol=1e-8)


def test_variances_are_those_of_the_dense_covariance(problem):
    noise, linear, track = levels(), problem.linear, problem.track
    own = filtered(track, linear, noise)
    force, errors, factors = variances(track, linear, own)
    covered = own.before @ own.before.swapaxes(1, 2)
    told = covered @ factors
    states = np.einsum("kii->ki", covered) - (told**2).sum(2)
    for run, rows in enumerate(track.slices()):
        dense, reads = Dense(problem, noise, run), linear.reads[rows]
        np.testing.assert_allclose(states[rows], dense.variances[:, :N], rtol=1e-8, atol=1e-10)
        asked = noise.forces[rows] ** 2 - noise.forces[rows] ** 4 * force[rows]
        np.testing.assert_allclose(asked, dense.variances[:, N:], rtol=1e-8, atol=1e-10)
        seen = np.einsum("kam,kmu,uv,knv,kan->ka", reads, dense.z, dense.covariance, dense.z, reads, optimize=True)
        expected = (noise.reading**2 - seen) / noise.reading**4
        known = np.isfinite(track.measured[rows])
        np.testing.assert_allclose(errors[rows][known], expected[known], rtol=1e-7)


@pytest.mark.parametrize("which", ["force", "reading"])
def test_levels_follow_the_gradient_of_the_marginal_likelihood(problem, which):
    force, reading, step = np.array([0.3, 0.8]), np.array([0.1, 0.2, 0.4]), 1e-5
    noise, linear, track = levels(force, reading), problem.linear, problem.track
    own = filtered(track, linear, noise)
    adjoint, errors = own.adjoint(track, linear, swept(track, linear, own, problem.pulls)[0][:, :, :1].copy())
    expected, error_variance, _ = variances(track, linear, own)
    if which == "force":
        told = force**2 * (expected - adjoint[:, N:, 0] ** 2).sum(0)
    else:
        told = reading**2 * (error_variance - errors[:, :, 0] ** 2).sum(0)
    for j, slope in enumerate(told):
        ends = []
        for sign in (1, -1):
            sizes = {"force": force.copy(), "reading": reading.copy()}
            sizes[which][j] *= np.exp(sign * step)
            ends.append(loss(problem, levels(**sizes)))
        assert slope == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-4)


def test_an_encoder_beside_a_free_speed_stays_definite():
    """What costs a filter of covariances its definiteness: a reading a million times as sure as the state."""
    problem = random_problem(2)
    problem.linear.spread[:] = 100.0
    own = filtered(problem.track, problem.linear, levels((100.0, 100.0), (1e-5, 1e-5, 1e-5)))
    known = np.isfinite(own.sd)
    assert np.isfinite(own.before).all() and (own.sd[known] >= 1e-5).all()
