"""Compiled loops of the exact grid belief: likelihood, normalisation and moments.

Cells are stored x fastest, then y, then z: cell (iz, iy, ix) has the index (iz * n_y + iy) * n_x + ix. The inner loops
run along x over contiguous float64, without branches, so that they vectorise. The mean rate is eq 1 of MUC-OSL at the
cell's centre, with |u - s| clamped so that the rate is finite in the cell itself (see `baselines.belief.grid`).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from baselines.belief.likelihood import LEAST_MEAN, log, log_saturated
from osl_env.numerics import exp
from osl_env.parameters import FloatArray

NEGLIGIBLE_EXPONENT = -37.0  # e**-37 = 1e-16: a rate this far below strength / clamp changes no double near 1


@njit(inline="always", error_model="numpy")
def _hits(
    dx: float, crosswise: float, along: float, drift_x: float, inverse_lambda: float, scale: float, clamp: float
) -> float:
    """Mean hits at the offset dx, m, along x, for `crosswise` = dy^2 + dz^2, m^2, and `along` = dy drift_y."""
    distance = max(math.sqrt(dx * dx + crosswise), clamp)
    return scale / distance * exp(dx * drift_x + along - distance * inverse_lambda)


@njit(cache=True, error_model="numpy")
def _add_reading(
    row: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    position: FloatArray,
    reading: float,
    sampling_time: float,
    model: FloatArray,
) -> None:
    """Add the log likelihood of one reading to `row` (cells,), up to a constant."""
    drift_x, drift_y, inverse_lambda = model[0], model[1], model[2]
    strength, clamp, background = model[3], model[4], model[5]
    n_x = xs.size
    ends = max((position[0] - xs[0]) * drift_x, (position[0] - xs[n_x - 1]) * drift_x)
    scale = strength * sampling_time
    noise = background * sampling_time
    cell = 0
    for iz in range(zs.size):
        dz = position[2] - zs[iz]
        for iy in range(ys.size):
            dy = position[1] - ys[iy]
            crosswise = dy * dy + dz * dz
            along = dy * drift_y
            out = row[cell : cell + n_x]
            cell += n_x
            if reading >= model[6]:
                for ix in range(n_x):
                    mean = noise + _hits(position[0] - xs[ix], crosswise, along, drift_x, inverse_lambda, scale, clamp)
                    out[ix] += log_saturated(reading, max(mean, LEAST_MEAN))
            elif reading > 0.0:
                for ix in range(n_x):
                    mean = noise + _hits(position[0] - xs[ix], crosswise, along, drift_x, inverse_lambda, scale, clamp)
                    out[ix] += reading * log(max(mean, LEAST_MEAN)) - mean
            elif ends + along - math.sqrt(crosswise) * inverse_lambda > NEGLIGIBLE_EXPONENT:
                for ix in range(n_x):
                    out[ix] -= _hits(position[0] - xs[ix], crosswise, along, drift_x, inverse_lambda, scale, clamp)


@njit(inline="always", error_model="numpy")
def _largest(row: FloatArray) -> float:
    """The largest entry. Four running maxima: one alone waits for itself at every cell."""
    a = b = c = d = -np.inf
    whole = row.size - row.size % 4
    for i in range(0, whole, 4):
        a, b, c, d = max(a, row[i]), max(b, row[i + 1]), max(c, row[i + 2]), max(d, row[i + 3])
    for i in range(whole, row.size):
        a = max(a, row[i])
    return max(max(a, b), max(c, d))


@njit(inline="always", error_model="numpy")
def _sum(row: FloatArray) -> float:
    """The sum of the entries, in four running sums."""
    a = b = c = d = 0.0
    whole = row.size - row.size % 4
    for i in range(0, whole, 4):
        a, b, c, d = a + row[i], b + row[i + 1], c + row[i + 2], d + row[i + 3]
    for i in range(whole, row.size):
        a += row[i]
    return (a + b) + (c + d)


@njit(cache=True, error_model="numpy")
def normalise(log_posterior: FloatArray, probability: FloatArray) -> None:
    """Make each row of `log_posterior` (B, cells) the log of a distribution and write that to `probability`.

    In place. A row without any finite entry becomes uniform: a belief that everything contradicts says nothing.
    """
    n_cells = log_posterior.shape[1]
    for b in range(log_posterior.shape[0]):
        row, p = log_posterior[b], probability[b]
        top = _largest(row)
        if not top > -np.inf:
            row[:] = 0.0
            top = 0.0
        for c in range(n_cells):
            p[c] = exp(row[c] - top)
        total = _sum(p)
        shift = top + math.log(total)
        inverse = 1.0 / total
        for c in range(n_cells):
            row[c] -= shift
            p[c] *= inverse


@njit(cache=True, error_model="numpy")
def update(
    log_posterior: FloatArray,
    probability: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
    zs: FloatArray,
    positions: FloatArray,
    readings: FloatArray,
    sampling_times: FloatArray,
    models: FloatArray,
) -> None:
    """Bayes' rule for M readings of each of B beliefs, in place, and normalisation.

    log_posterior, probability (B, cells); xs (n_x,), ys, zs: cell centres, m; positions (B, M, 3) m; readings (B, M)
    hits; sampling_times (B, M) s, 0 or less for no reading; models (B, 7): drift V / (2 D) along x and y (1/m),
    1 / lambda (1/m), strength a Q (m/s), clamp distance (m), false-positive rate (1/s), hits that saturate a reading.
    """
    for b in range(log_posterior.shape[0]):
        for m in range(readings.shape[1]):
            if sampling_times[b, m] > 0.0:
                _add_reading(
                    log_posterior[b],
                    xs,
                    ys,
                    zs,
                    positions[b, m],
                    readings[b, m],
                    sampling_times[b, m],
                    models[b],
                )
    normalise(log_posterior, probability)


@njit(cache=True, error_model="numpy")
def marginals(probability: FloatArray, along_x: FloatArray, along_y: FloatArray, along_z: FloatArray) -> None:
    """Mass of each layer of cells of `probability` (B, cells): along_x (B, n_x), along_y (B, n_y), along_z (B, n_z)."""
    n_x, n_y = along_x.shape[1], along_y.shape[1]
    for b in range(probability.shape[0]):
        along_x[b], along_y[b], along_z[b] = 0.0, 0.0, 0.0
        for iz in range(along_z.shape[1]):
            for iy in range(n_y):
                p = probability[b, (iz * n_y + iy) * n_x : (iz * n_y + iy + 1) * n_x]
                mass = 0.0
                for ix in range(n_x):
                    along_x[b, ix] += p[ix]
                    mass += p[ix]
                along_y[b, iy] += mass
                along_z[b, iz] += mass


@njit(cache=True, error_model="numpy")
def moments(
    probability: FloatArray, xs: FloatArray, ys: FloatArray, zs: FloatArray, mean: FloatArray, covariance: FloatArray
) -> None:
    """Mean (B, 3) m and covariance (B, 3, 3) m^2 of the cell centres under `probability` (B, cells)."""
    n_x, n_y = xs.size, ys.size
    for b in range(probability.shape[0]):
        total = np.zeros(9)  # sums of x, y, z, xx, yy, zz, xy, xz, yz
        for iz in range(zs.size):
            z = zs[iz]
            for iy in range(n_y):
                y = ys[iy]
                p = probability[b, (iz * n_y + iy) * n_x : (iz * n_y + iy + 1) * n_x]
                mass, first, second = 0.0, 0.0, 0.0
                for ix in range(n_x):
                    weighted = p[ix] * xs[ix]
                    mass += p[ix]
                    first += weighted
                    second += weighted * xs[ix]
                total[0] += first
                total[1] += mass * y
                total[2] += mass * z
                total[3] += second
                total[4] += mass * y * y
                total[5] += mass * z * z
                total[6] += first * y
                total[7] += first * z
                total[8] += mass * y * z
        mx, my, mz = total[0], total[1], total[2]
        mean[b, 0], mean[b, 1], mean[b, 2] = mx, my, mz
        covariance[b, 0, 0] = max(total[3] - mx * mx, 0.0)
        covariance[b, 1, 1] = max(total[4] - my * my, 0.0)
        covariance[b, 2, 2] = max(total[5] - mz * mz, 0.0)
        covariance[b, 0, 1] = covariance[b, 1, 0] = total[6] - mx * my
        covariance[b, 0, 2] = covariance[b, 2, 0] = total[7] - mx * mz
        covariance[b, 1, 2] = covariance[b, 2, 1] = total[8] - my * mz
