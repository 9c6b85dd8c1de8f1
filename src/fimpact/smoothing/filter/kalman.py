"""Square-root Kalman filter and adjoint smoother of a linear-Gaussian trajectory with a missing force.

State of a sample: z = (x, tau), the deviation of the state, (n,), and of the missing force, (nv,), from where the model
was linearised. x' = A z + offset; tau' is drawn anew in each sample. Covariances are kept as factors (Potter's update,
Householder's time step), because an encoder of 1e-5 rad beside a free speed costs a plain filter its definiteness.

Means are matrices: the first column belongs to the data, every other one to a unit of one parameter or hypothesis.
References: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977; Koopman, Biometrika 80(1), 1993.
"""

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _triangular(rows: np.ndarray) -> np.ndarray:
    """Lower factor L, (n, n), with L L' = rows rows', of `rows` (n, m), m >= n, by Householder reflections."""
    n, m = rows.shape
    for i in range(n):
        size = 0.0
        for j in range(i, m):
            size += rows[i, j] ** 2
        size = np.sqrt(size)
        if size == 0.0:
            continue
        head = rows[i, i]
        along = -size if head > 0 else size
        rows[i, i] = head - along
        square = size * size - head * along
        for k in range(i + 1, n):
            dot = 0.0
            for j in range(i, m):
                dot += rows[i, j] * rows[k, j]
            dot /= square
            for j in range(i, m):
                rows[k, j] -= dot * rows[i, j]
        rows[i, i] = along
        for j in range(i + 1, m):
            rows[i, j] = 0.0
    return rows[:, :n].copy()


@numba.njit(cache=True, nogil=True)
def covariances(bounds, advance, reads, noise, force, start):
    """Filter the covariances of runs that lie one after the other.

    Args:
        bounds: (runs + 1,) row at which each run begins, and the end. advance: (K, n, m) of z to the next x. reads:
            (K, ny, m) of z to the readings. noise: (K, ny) sd, inf: nothing was read. force: (K, nv) sd of the missing
            force. start: (runs, n, n) factor of each first state's covariance.

    Returns:
        Gain (K, ny, m) of each reading, taken one after the other; sd (K, ny) of its innovation, inf where nothing was
        read; factor (K, n, n) of each state's covariance before its readings.
    """
    samples, n, m = advance.shape
    ny, nv = reads.shape[1], m - n
    gains, sd, before = np.zeros((samples, ny, m)), np.full((samples, ny), np.inf), np.zeros((samples, n, n))
    factor = np.zeros((m, m))
    for run in range(len(bounds) - 1):
        state = start[run].copy()
        for k in range(bounds[run], bounds[run + 1]):
            before[k] = state
            factor[:] = 0.0
            factor[:n, :n] = state
            for j in range(nv):
                factor[n + j, n + j] = force[k, j]
            for a in range(ny):
                own = noise[k, a]
                if not np.isfinite(own):
                    continue
                seen = np.zeros(m)
                for i in range(m):
                    h = reads[k, a, i]
                    if h != 0.0:
                        for j in range(m):
                            seen[j] += h * factor[i, j]
                total = own * own
                for j in range(m):
                    total += seen[j] ** 2
                gain = factor @ seen / total
                gains[k, a] = gain
                sd[k, a] = np.sqrt(total)
                share = 1.0 / (1.0 + own / sd[k, a])
                for i in range(m):
                    g = gain[i] * share
                    if g != 0.0:
                        for j in range(m):
                            factor[i, j] -= g * seen[j]
            if k < bounds[run + 1] - 1:
                state = _triangular(advance[k] @ factor)
    return gains, sd, before


@numba.njit(cache=True, nogil=True)
def means(bounds, advance, reads, gains, sd, first, offsets, off_reads, pulls):
    """Filter the means of runs, all columns at once.

    Args:
        bounds: as in `covariances`. first: (runs, n, c) mean of each first state. offsets: (K, n, c0), off_reads: (K,
            ny, c0) what each of the first c0 columns adds to the next state and to the readings left. pulls: (K, nv, c)
            mean of the missing force.

    Returns:
        Innovations in sd, (K, ny, c), 0 where nothing was read, and the mean of z before the readings, (K, m, c).
    """
    samples, n, m = advance.shape
    ny, c, c0 = reads.shape[1], first.shape[2], offsets.shape[2]
    out, kept = np.zeros((samples, ny, c)), np.zeros((samples, m, c))
    mean = np.zeros((m, c))
    for run in range(len(bounds) - 1):
        mean[:n] = first[run]
        for k in range(bounds[run], bounds[run + 1]):
            mean[n:] = pulls[k]
            kept[k] = mean
            for a in range(ny):
                if not np.isfinite(sd[k, a]):
                    continue
                left = np.zeros(c)
                for i in range(m):
                    h = reads[k, a, i]
                    if h != 0.0:
                        for j in range(c):
                            left[j] -= h * mean[i, j]
                for j in range(c0):
                    left[j] += off_reads[k, a, j]
                for i in range(m):
                    g = gains[k, a, i]
                    if g != 0.0:
                        for j in range(c):
                            mean[i, j] += g * left[j]
                for j in range(c):
                    out[k, a, j] = left[j] / sd[k, a]
            if k < bounds[run + 1] - 1:
                mean[:n] = advance[k] @ mean
                mean[:n, :c0] += offsets[k]
    return out, kept


@numba.njit(cache=True, nogil=True)
def adjoint(bounds, advance, reads, gains, sd, innovations):
    """Run back through the innovations of runs, (K, ny, c), in sd.

    Args:
        bounds: as in `covariances`.

    Returns:
        (K, m, c) adjoint of z before the readings: the smoothed z is its mean minus its covariance times this; (K, ny,
        c) the smoothing error of each reading, divided by the variance of its noise.
    """
    samples, n, m = advance.shape
    ny, c = innovations.shape[1], innovations.shape[2]
    out, errors = np.zeros((samples, m, c)), np.zeros((samples, ny, c))
    for run in range(len(bounds) - 1):
        back = np.zeros((m, c))
        for k in range(bounds[run + 1] - 1, bounds[run] - 1, -1):
            if k < bounds[run + 1] - 1:
                back = advance[k].T @ np.ascontiguousarray(out[k + 1, :n])
            for a in range(ny - 1, -1, -1):
                if not np.isfinite(sd[k, a]):
                    continue
                left = np.zeros(c)
                for i in range(m):
                    g = gains[k, a, i]
                    if g != 0.0:
                        for j in range(c):
                            left[j] += g * back[i, j]
                for j in range(c):
                    left[j] += innovations[k, a, j] / sd[k, a]
                    errors[k, a, j] = left[j]
                for i in range(m):
                    h = reads[k, a, i]
                    if h != 0.0:
                        for j in range(c):
                            back[i, j] -= h * left[j]
            out[k] = back
    return out, errors


@numba.njit(cache=True, nogil=True)
def adjoint_variances(bounds, advance, reads, gains, sd):
    """Variances of what `adjoint` returns, for the data's own column: (K, nv) of the force's part, (K, ny) of the
    smoothing errors, and (K, n, n) factor of the state's part. Carried as factors, as the covariances are."""
    samples, n, m = advance.shape
    ny, nv = reads.shape[1], m - n
    force, errors, states = np.zeros((samples, nv)), np.zeros((samples, ny)), np.zeros((samples, n, n))
    factor = np.zeros((m, m + ny))
    for run in range(len(bounds) - 1):
        for k in range(bounds[run + 1] - 1, bounds[run] - 1, -1):
            factor[:] = 0.0
            if k < bounds[run + 1] - 1:
                factor[:, :n] = advance[k].T @ states[k + 1]
            for a in range(ny - 1, -1, -1):
                if not np.isfinite(sd[k, a]):
                    continue
                gain, h = gains[k, a], reads[k, a]
                along = gain @ factor
                size = 1.0 / sd[k, a] ** 2
                for j in range(m + ny):
                    size += along[j] ** 2
                errors[k, a] = size
                for i in range(m):
                    if h[i] != 0.0:
                        for j in range(m + ny):
                            factor[i, j] -= h[i] * along[j]
                        factor[i, m + a] += h[i] / sd[k, a]
            for j in range(nv):
                for i in range(m + ny):
                    force[k, j] += factor[n + j, i] ** 2
            states[k] = _triangular(factor[:n].copy())
    return force, errors, states
