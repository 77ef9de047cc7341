"""Gaussians of particle clouds: weighted fit, divergence, and the triangular root used for roughening.

Fit: MUC-OSL eqs 19 and 20. Divergence: the closed form for two Gaussians in three dimensions,

    KL(P || Q) = (tr(S_q^-1 S_p) + (m_q - m_p)^T S_q^-1 (m_q - m_p) - 3 + ln(det S_q / det S_p)) / 2.

A Gaussian is one array (12,): mean (3), m, then covariance (9, row by row), m^2; that is also what a UAV sends. A
cloud may have collapsed to a plane, a line or a point, so `COVARIANCE_FLOOR` is added to the diagonals before they are
inverted.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from osl_env.parameters import FloatArray

GAUSSIAN_NUMBERS = 12  # mean and covariance, the paper's Gaussian message
COVARIANCE_FLOOR = 0.01  # m^2: beliefs are not told apart below 0.1 m, far below the declaration's 2 m


@njit(cache=True, error_model="numpy")
def fit_gaussian(x: FloatArray, y: FloatArray, z: FloatArray, weights: FloatArray, gaussian: FloatArray) -> None:
    """Write mean and covariance of particles x, y, z (n,), m, with normalised `weights` (n,) to `gaussian` (12,)."""
    mx = my = mz = 0.0
    for n in range(x.shape[0]):
        mx += weights[n] * x[n]
        my += weights[n] * y[n]
        mz += weights[n] * z[n]
    xx = xy = xz = yy = yz = zz = 0.0
    for n in range(x.shape[0]):
        dx, dy, dz = x[n] - mx, y[n] - my, z[n] - mz
        wx, wy = weights[n] * dx, weights[n] * dy
        xx += wx * dx
        xy += wx * dy
        xz += wx * dz
        yy += wy * dy
        yz += wy * dz
        zz += weights[n] * dz * dz
    gaussian[0], gaussian[1], gaussian[2] = mx, my, mz
    gaussian[3], gaussian[4], gaussian[5] = xx, xy, xz
    gaussian[6], gaussian[7], gaussian[8] = xy, yy, yz
    gaussian[9], gaussian[10], gaussian[11] = xz, yz, zz


@njit(cache=True, error_model="numpy")
def triangular_root(gaussian: FloatArray, floor: float, root: FloatArray) -> None:
    """Write the lower Cholesky factor (3, 3), m, of the covariance plus `floor` (m^2, > 0) on its diagonal to `root`.

    Rounding (a covariance sent in single precision) cannot make it fail: pivots are at least half the floor.
    """
    least = math.sqrt(0.5 * floor)
    for i in range(3):
        for j in range(i + 1):
            rest = gaussian[3 + 3 * i + j]
            if i == j:
                rest += floor
            for k in range(j):
                rest -= root[i, k] * root[j, k]
            root[i, j] = math.sqrt(max(rest, least * least)) if i == j else rest / root[j, j]
        for j in range(i + 1, 3):
            root[i, j] = 0.0


@njit(cache=True, error_model="numpy")
def kl_divergence(p: FloatArray, q: FloatArray) -> float:
    """KL(P || Q), nats, of two Gaussians (12,), with `COVARIANCE_FLOOR` added to both diagonals. At least 0."""
    root_p, root_q = np.empty((3, 3)), np.empty((3, 3))
    triangular_root(p, COVARIANCE_FLOOR, root_p)
    triangular_root(q, COVARIANCE_FLOOR, root_q)
    total = -3.0
    solved = np.empty(3)
    for column in range(4):  # L_q^-1 times each column of L_p, then times the difference of the means
        for i in range(3):
            rest = root_p[i, column] if column < 3 else q[i] - p[i]
            for k in range(i):
                rest -= root_q[i, k] * solved[k]
            solved[i] = rest / root_q[i, i]
            total += solved[i] * solved[i]
    for i in range(3):
        total += 2.0 * math.log(root_q[i, i] / root_p[i, i])
    return max(0.5 * total, 0.0)
