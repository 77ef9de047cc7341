"""Kernels of the spatially correlated wind (`turbulence`): coloured noise at the corners, and the flow between them.

A world's row of memory holds the noise of 2 components x 4 corners, its rates of change, then u and v on the nodes.
Corners are in the order (low x, low y), (high, low), (low, high), (high, high).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.numerics import normal
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray
from osl_env.streams import Purpose, derive
from osl_env.winds.mean_wind import FLUCTUATION

_WIND = int(Purpose.WIND)
_NOISES = 8  # 2 components x 4 corners
NOISE_COLUMNS = 2 * _NOISES
_COURANT = 0.9  # of the largest step for which every new value is a mean of old ones
_PHASE = 0.25  # rad of the noise's oscillation that a substep may take


class Flow(NamedTuple):
    """The numbers of the flow."""

    nx: int
    ny: int
    dx: float  # m between nodes
    dy: float
    diffusivity: float  # K / 2, m^2/s
    std: float  # m/s, of the noise
    bandwidth: float  # omega, rad/s
    damping: float  # zeta
    development: float  # s of flow before an episode


@njit(cache=True, error_model="numpy")
def noise_coefficients(step: float, std: float, omega: float, zeta: float) -> tuple[float, ...]:
    """The oscillator's exact solution over `step` s: x' = a x + b y + p n, y' = c x + d y + q n + r m; n, m normal.

    The noise is what the stationary variances, std^2 and (omega std)^2, lack after the decay.
    """
    decay = math.exp(-zeta * omega * step)
    frequency = omega * math.sqrt(max(1.0 - zeta * zeta, 0.0))
    phase = frequency * step
    sinc = math.sin(phase) / frequency if phase > 1e-6 else step
    cosine, drift = math.cos(phase), zeta * omega * sinc
    a, b = decay * (cosine + drift), decay * sinc
    c, d = -omega * omega * decay * sinc, decay * (cosine - drift)
    x, y = std * std, omega * omega * std * std
    of_y = y - (c * c * x + d * d * y)
    of_both = -(a * c * x + b * d * y)
    of_x = x - (a * a * x + b * b * y)
    q = math.sqrt(max(of_y, 0.0))
    p = of_both / q if q > 0.0 else 0.0
    return a, b, c, d, p, math.sqrt(max(of_x - p * p, 0.0)), q


@njit(cache=True, error_model="numpy")
def _advance_noise(noise: FloatArray, stream: np.uint64, step: float, flow: Flow) -> np.uint64:
    a, b, c, d, p, r, q = noise_coefficients(step, flow.std, flow.bandwidth, flow.damping)
    for k in range(_NOISES):
        stream, n = normal(stream)
        stream, m = normal(stream)
        x, y = noise[k], noise[_NOISES + k]
        noise[k] = a * x + b * y + p * n + r * m
        noise[_NOISES + k] = c * x + d * y + q * n
    return stream


@njit(cache=True, error_model="numpy")
def _between_corners(noise: FloatArray, mean: FloatArray, field: FloatArray, everywhere: bool) -> None:
    """Set the edges of `field` (2, nx, ny), or all of it, by (bi)linear interpolation of the corners."""
    _, nx, ny = field.shape
    for component in range(2):
        corners = noise[4 * component : 4 * component + 4]
        for i in range(nx):
            a = i / (nx - 1.0)
            inside = 0 < i < nx - 1 and not everywhere
            for j in range(0, ny, ny - 1 if inside else 1):
                b = j / (ny - 1.0)
                low = (1.0 - a) * corners[0] + a * corners[1]
                high = (1.0 - a) * corners[2] + a * corners[3]
                field[component, i, j] = mean[component] + (1.0 - b) * low + b * high


@njit(cache=True, error_model="numpy")
def _advance_interior(old: FloatArray, field: FloatArray, step: float, flow: Flow) -> None:
    """One explicit step of the nodes inside, from `old` into `field`, both (2, nx, ny)."""
    _, nx, ny = field.shape
    dx, dy, k = flow.dx, flow.dy, flow.diffusivity
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            u, v = old[0, i, j], old[1, i, j]
            across_x = max(k, abs(u) * dx / 2.0) / (dx * dx)
            across_y = max(k, abs(v) * dy / 2.0) / (dy * dy)
            drift_x, drift_y = u / (2.0 * dx), v / (2.0 * dy)
            for component in range(2):
                f = old[component]
                here = f[i, j]
                change = (across_x + drift_x) * (f[i - 1, j] - here) + (across_x - drift_x) * (f[i + 1, j] - here)
                change += (across_y + drift_y) * (f[i, j - 1] - here) + (across_y - drift_y) * (f[i, j + 1] - here)
                field[component, i, j] = here + step * change


@njit(cache=True, error_model="numpy")
def _advance_flow(row: FloatArray, mean: FloatArray, stream: np.uint64, time: float, flow: Flow) -> np.uint64:
    """`time` s of noise and flow in the row of memory of one world, in as many substeps as stability needs."""
    noise = row[:NOISE_COLUMNS]
    field = row[NOISE_COLUMNS:].reshape(2, flow.nx, flow.ny)
    old = np.empty_like(field)
    left = time
    while left > 0.0:
        u = v = 0.0
        for i in range(flow.nx):
            for j in range(flow.ny):
                u, v = max(u, abs(field[0, i, j])), max(v, abs(field[1, i, j]))
        rate = 2.0 * max(flow.diffusivity, u * flow.dx / 2.0) / flow.dx**2
        rate += 2.0 * max(flow.diffusivity, v * flow.dy / 2.0) / flow.dy**2
        substeps = math.ceil(left * max(rate / _COURANT, flow.bandwidth / _PHASE))
        step = left / max(substeps, 1.0)
        old[:] = field
        stream = _advance_noise(noise, stream, step, flow)
        _between_corners(noise, mean, field, False)
        _advance_interior(old, field, step, flow)
        left = left - step if substeps > 1.0 else 0.0
    return stream


@njit(cache=True, error_model="numpy")
def _show(row: FloatArray, grid: NDArray[np.float32], e: int) -> None:
    """Copy the flow of world `e` from its row of memory to its frame of the air."""
    _, nx, ny, _, _ = grid.shape
    field = row[NOISE_COLUMNS:].reshape(2, nx, ny)
    for i in range(nx):
        for j in range(ny):
            grid[e, i, j, 0, 0], grid[e, i, j, 0, 1] = field[0, i, j], field[1, i, j]


@njit(cache=True, error_model="numpy")
def begin_flows(
    rows: IntArray,
    seeds: IntArray,
    flow: Flow,
    means: FloatArray,
    memory: FloatArray,
    streams: NDArray[np.uint64],
    grid: NDArray[np.float32],
) -> None:
    """Stationary noise and a developed flow in the worlds `rows` for the episodes with `seeds`."""
    for k in range(rows.size):
        e = rows[k]
        row = memory[e]
        stream = derive(seeds[k], _WIND, FLUCTUATION)
        for n in range(_NOISES):
            stream, x = normal(stream)
            stream, y = normal(stream)
            row[n], row[_NOISES + n] = flow.std * x, flow.std * flow.bandwidth * y
        field = row[NOISE_COLUMNS:].reshape(2, flow.nx, flow.ny)
        _between_corners(row[:NOISE_COLUMNS], means[e], field, True)
        streams[e] = _advance_flow(row, means[e], stream, flow.development, flow)
        _show(row, grid, e)


@njit(cache=True, error_model="numpy")
def advance_flows(
    due: BoolArray,
    tick: float,
    flow: Flow,
    means: FloatArray,
    memory: FloatArray,
    streams: NDArray[np.uint64],
    grid: NDArray[np.float32],
) -> None:
    """Move the flow in the worlds of `due` (n_envs,) on by `tick` s."""
    for e in range(due.size):
        if due[e]:
            streams[e] = _advance_flow(memory[e], means[e], streams[e], tick, flow)
            _show(memory[e], grid, e)
