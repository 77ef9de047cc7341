"""Kernels of the belief features: a particle filter for each listener of a batch of worlds, in single precision.

One update is Bayes' rule with the advertised plume and sensor (`baselines.belief.likelihood`), weighted moments, and,
where the effective sample size is low, systematic resampling and roughening (see `baselines.belief.particle_filter`).
What differs, for speed and so that equal readings give equal beliefs:

- the prior is a low-discrepancy set (Roberts' R3 sequence, generalised golden ratio), the same in every episode;
- roughening adds noise from a box of unit variance (the kernel's shape matters little; Silverman 1986), drawn from a
  stream that depends on nothing but how often the listener has resampled: a belief is a function of the readings;
- moments are those of the weighted cloud before it is resampled, which sampling would only make noisier.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.gaussian_fit import triangular_root
from baselines.belief.likelihood import LEAST_MEAN, log, log_saturated
from osl_env.numerics import GAMMA, mix
from osl_env.parameters import FloatArray
from osl_env.state import IntArray, StateArray

Float32Array = NDArray[np.float32]

ROWS = 5  # of a cloud: x, y, z (m), log weight, weight
X, Y, Z, LOG_WEIGHT, WEIGHT = range(ROWS)
MOMENTS = 12  # mean (3), m, and covariance (9), m^2
STRENGTH, DIFFUSIVITY, LIFETIME, CLAMP, BACKGROUND, DETECTION, MAX_COUNT = range(7)  # of plume and sensor
WINDS, EAST, NORTH, HITS, LAST_HIT = range(5)  # of what a listener remembers
MEMORY = 5
MASS = 1 << 24  # a belief of 1 as an integer: sums of integers vectorise, and do not depend on their order
FINE = 1 << 30  # 1 as an integer in the sums of moments, which never exceed 1 in units of the longest side
_FLOOR = 1e-12  # m^2, as in `particle_filter`
_R3 = 1.2207440846057596  # root of x^4 = x + 1

_LOG2_E = np.float32(1.4426950408889634)
_LN2_HIGH, _LN2_LOW = np.float32(0.693359375), np.float32(-2.12194440e-4)  # ln 2 in two parts (Cody and Waite)
_ROUND = np.float32(12582912.0)  # 1.5 * 2^23: adding it rounds a single to the nearest integer
_ONE_BITS, _MANTISSA_BITS = np.int32(0x3F800000), np.int32(23)
_C2, _C3, _C4, _C5, _C6, _C7 = (np.float32(1.0 / math.factorial(k)) for k in range(2, 8))
_NEVER = np.float32(-1e6)  # least log weight
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_MASS, _FINE = np.float32(MASS), np.float32(FINE)
_LEAST, _MOST = np.float32(-87.0), np.float32(80.0)
_U43, _U21 = np.uint64(43), np.uint64(21)
_LOW_21 = np.uint64((1 << 21) - 1)
_BOX = np.float32(2.0 * math.sqrt(3.0) / (1 << 21))  # 21 random bits to a box of unit variance
_HALF_BOX = np.float32(math.sqrt(3.0))


@njit(inline="always", error_model="numpy")
def exp32(x: Any) -> Any:
    """e**x in single precision (to 2e-7) for -87 <= x <= 80; clamped to that range outside it. Vectorises."""
    x = min(max(x, _LEAST), _MOST)
    shifted = x * _LOG2_E + _ROUND
    k = shifted - _ROUND
    r = (x - k * _LN2_HIGH) - k * _LN2_LOW
    p = ((((((_C7 * r + _C6) * r + _C5) * r + _C4) * r + _C3) * r + _C2) * r + _ONE) * r + _ONE
    bits = (np.float32(shifted).view(np.int32) << _MANTISSA_BITS) + _ONE_BITS
    return p * np.int32(bits).view(np.float32)


def prior(count: int, area: FloatArray) -> Float32Array:
    """A cloud (5, count) of equal weights, evenly spread over [0, `area`] (3,), m."""
    cloud = np.zeros((ROWS, count), dtype=np.float32)
    steps = np.arange(count)[None, :] * (1.0 / _R3 ** np.arange(1, 4))[:, None]
    cloud[:3] = (0.5 + steps) % 1.0 * np.asarray(area)[:, None]
    cloud[LOG_WEIGHT], cloud[WEIGHT] = -math.log(count), 1.0 / count
    return cloud


@njit(error_model="numpy")
def _weigh(cloud: Any, reading: Any, memory: Any, plume: Any) -> None:
    """Add the log likelihood of `reading` (6,) to the log weights, up to a constant."""
    east, north = memory[EAST], memory[NORTH]
    half = 0.5 / plume[DIFFUSIVITY]
    growth = 1.0 + (east * east + north * north) * plume[LIFETIME] / (4.0 * plume[DIFFUSIVITY])
    drift_x, drift_y = np.float32(half * east), np.float32(half * north)
    inverse_lambda = np.float32(math.sqrt(growth / (plume[DIFFUSIVITY] * plume[LIFETIME])))
    ux, uy, uz = np.float32(reading[0]), np.float32(reading[1]), np.float32(reading[2])
    clamp = np.float32(plume[CLAMP])
    hits = reading[3]
    scale = np.float32(plume[STRENGTH] * plume[DETECTION] * reading[4])  # hits m
    background = np.float32(plume[BACKGROUND] * reading[4])  # hits
    x, y, z, log_weight = cloud[X], cloud[Y], cloud[Z], cloud[LOG_WEIGHT]
    if hits >= plume[MAX_COUNT]:
        for n in range(x.size):
            dx, dy, dz = ux - x[n], uy - y[n], uz - z[n]
            distance = max(np.float32(math.sqrt(dx * dx + dy * dy + dz * dz)), clamp)
            mean = scale / distance * exp32(dx * drift_x + dy * drift_y - distance * inverse_lambda) + background
            log_weight[n] += np.float32(log_saturated(hits, max(np.float64(mean), LEAST_MEAN)))
        return
    for n in range(x.size):
        dx, dy, dz = ux - x[n], uy - y[n], uz - z[n]
        distance = max(np.float32(math.sqrt(dx * dx + dy * dy + dz * dz)), clamp)
        log_weight[n] -= scale / distance * exp32(dx * drift_x + dy * drift_y - distance * inverse_lambda)
    if hits <= 0.0:
        return
    for n in range(x.size):
        dx, dy, dz = ux - x[n], uy - y[n], uz - z[n]
        distance = max(np.float32(math.sqrt(dx * dx + dy * dy + dz * dz)), clamp)
        exponent = dx * drift_x + dy * drift_y - distance * inverse_lambda
        if background > 0.0:
            log_mean = log(np.float64(scale / distance * exp32(exponent) + background))
        else:
            log_mean = exponent - log(np.float64(distance))
        log_weight[n] += np.float32(hits * log_mean)


@njit(error_model="numpy")
def normalise(cloud: Any, moments: Any, masses: Any, side: float) -> float:
    """Make the weights of `cloud` (5, n), sum 1, from the log weights; fit `moments` (12,). The effective sample size.

    Sums are taken in integers (see `MASS`), of offsets from the old mean in units of the area's longest `side`, m.
    The greatest log weight is looked for only where weights would vanish; else their level is kept. `masses` (n,) int32
    gets the weights as integers.
    """
    total = _weights(cloud, np.float32(0.0))
    if not 1e-20 < total < 1e20:
        total = _weights(cloud, cloud[LOG_WEIGHT].max())
    x, y, z, log_weight, weight = cloud[X], cloud[Y], cloud[Z], cloud[LOG_WEIGHT], cloud[WEIGHT]
    inverse, level = np.float32(1.0 / total), np.float32(math.log(total))
    for n in range(x.size):
        log_weight[n] = max(log_weight[n] - level, _NEVER)
        weight[n] *= inverse
        masses[n] = np.int32(weight[n] * _MASS)
    rx, ry, rz = np.float32(moments[0]), np.float32(moments[1]), np.float32(moments[2])
    unit = np.float32(1.0 / side)
    squares = np.int64(0)
    mx = my = mz = xx = xy = xz = yy = yz = zz = np.int32(0)
    for n in range(x.size):
        squares += np.int64(masses[n]) * np.int64(masses[n])
    for n in range(x.size):
        dx, dy, dz = (x[n] - rx) * unit, (y[n] - ry) * unit, (z[n] - rz) * unit
        w = weight[n] * _FINE
        wx, wy, wz = w * dx, w * dy, w * dz
        mx += np.int32(wx)
        my += np.int32(wy)
        mz += np.int32(wz)
        xx += np.int32(wx * dx)
        xy += np.int32(wx * dy)
        xz += np.int32(wx * dz)
        yy += np.int32(wy * dy)
        yz += np.int32(wy * dz)
        zz += np.int32(wz * dz)
    length, area = side / FINE, side * side / FINE
    a, b, c = mx * length, my * length, mz * length
    moments[0] += a
    moments[1] += b
    moments[2] += c
    moments[3], moments[4], moments[5] = xx * area - a * a, xy * area - a * b, xz * area - a * c
    moments[6], moments[7], moments[8] = moments[4], yy * area - b * b, yz * area - b * c
    moments[9], moments[10], moments[11] = moments[5], moments[8], zz * area - c * c
    return float(MASS) * MASS / squares


@njit(error_model="numpy")
def _weights(cloud: Any, reference: Any) -> float:
    """The weights, not normalised, from the log weights less `reference`, which is subtracted; their sum."""
    log_weight, weight = cloud[LOG_WEIGHT], cloud[WEIGHT]
    for n in range(weight.size):
        log_weight[n] -= reference
        weight[n] = exp32(log_weight[n])
    a, b, c, d = _ZERO, _ZERO, _ZERO, _ZERO  # four sums, which do not wait for each other
    for n in range(0, weight.size, 4):
        a += weight[n]
        b += weight[n + 1]
        c += weight[n + 2]
        d += weight[n + 3]
    return float((a + b) + (c + d))


@njit(error_model="numpy")
def _resample(cloud: Any, moments: Any, area: Any, roughening: float, spare: Any, root: Any, draws: int) -> None:
    """Systematic resampling with equal weights, and roughening; `draws`: how often the listener has resampled."""
    count = cloud.shape[1]
    state = mix(np.uint64(draws) * GAMMA)
    u = float(mix(state) >> _U43) / (1 << 21)
    source, cumulative = 0, float(cloud[WEIGHT, 0])
    for n in range(count):
        tooth = (u + n) / count
        while cumulative <= tooth and source < count - 1:
            source += 1
            cumulative += cloud[WEIGHT, source]
        for axis in range(3):
            spare[axis, n] = cloud[axis, source]
    triangular_root(moments, _FLOOR, root)
    bandwidth = roughening * (4.0 / (5.0 * count)) ** (1.0 / 7.0)
    for n in range(count):
        state += GAMMA
        bits = mix(state)
        a = np.float32(bits >> _U43) * _BOX - _HALF_BOX
        b = np.float32((bits >> _U21) & _LOW_21) * _BOX - _HALF_BOX
        c = np.float32(bits & _LOW_21) * _BOX - _HALF_BOX
        x = spare[X, n] + bandwidth * root[0, 0] * a
        y = spare[Y, n] + bandwidth * (root[1, 0] * a + root[1, 1] * b)
        z = spare[Z, n] + bandwidth * (root[2, 0] * a + root[2, 1] * b + root[2, 2] * c)
        inside = 0.0 <= x <= area[0] and 0.0 <= y <= area[1] and 0.0 <= z <= area[2]
        cloud[X, n] = x if inside else spare[X, n]
        cloud[Y, n] = y if inside else spare[Y, n]
        cloud[Z, n] = z if inside else spare[Z, n]
    cloud[LOG_WEIGHT] = -math.log(count)
    cloud[WEIGHT] = 1.0 / count


@njit(error_model="numpy")
def _recall(memory: Any, wind: Any, rows: Any, count: int) -> None:
    """Take in one wind measurement (a running mean, as in `AdvertisedPlume`), and count the hits of the readings."""
    memory[WINDS] += 1.0
    memory[EAST] += (wind[0] - memory[EAST]) / memory[WINDS]
    memory[NORTH] += (wind[1] - memory[NORTH]) / memory[WINDS]
    for f in range(count):
        if rows[f, 3] > 0.0:
            memory[HITS] += rows[f, 3]
            memory[LAST_HIT] = max(memory[LAST_HIT], rows[f, 5])


@njit(cache=True, error_model="numpy")
def update_clouds(
    motion: StateArray,
    senses: StateArray,
    rows: FloatArray,
    count: IntArray,
    plume: FloatArray,
    area: FloatArray,
    resample_below: float,
    roughening: float,
    clouds: Float32Array,
    moments: FloatArray,
    memory: FloatArray,
    resamplings: IntArray,
) -> None:
    """One update of every listener that has new readings, of `clouds` (n_worlds, n_listeners, 5, n) and the rest."""
    n_listeners, n = clouds.shape[1], clouds.shape[3]
    spare, root = np.empty((3, n), dtype=np.float32), np.empty((3, 3))
    masses, side = np.empty(n, dtype=np.int32), area.max()
    for e in range(clouds.shape[0]):
        for listener in range(n_listeners):
            if count[e, listener] == 0:
                continue
            uav = listener
            if n_listeners < motion.shape[1]:  # all measure the same wind: that of the first that flies
                while not (motion[e, uav].active and motion[e, uav].ready):
                    uav += 1
            own = memory[e, listener]
            _recall(own, senses[e, uav].wind, rows[e, listener], count[e, listener])
            cloud = clouds[e, listener]
            for f in range(count[e, listener]):
                if rows[e, listener, f, 4] > 0.0:
                    _weigh(cloud, rows[e, listener, f], own, plume)
            effective = normalise(cloud, moments[e, listener], masses, side)
            if effective < resample_below * n:
                _resample(cloud, moments[e, listener], area, roughening, spare, root, resamplings[e, listener])
                resamplings[e, listener] += 1
