"""Particle belief over the source's position: Bayes in the log domain, resampling, roughening, Gaussian fit.

The cloud is one array (5, n) of rows x, y, z (m), weight and log weight. The prior is uniform over the search area.
One update is one compiled call:

    log w_n += sum_f power_f ln p(d_f | o_n);   normalise;   resample if ESS < share N;   roughen;   fit a Gaussian

Powers are 1 in Bayes' rule; Col-PF weakens what neighbours measured by them (MUC-OSL eq 11). Roughening after
resampling is that of the regularised particle filter (Musso, Oudjane and Le Gland 2001): a Gaussian kernel with the
cloud's own covariance,

    bandwidth = factor * (4 / ((d + 2) N))^(1 / (d + 4)),   d = 3     (Silverman's rule);

moves out of the area are rejected, for the prior is zero there.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.gaussian_fit import GAUSSIAN_NUMBERS, fit_gaussian, triangular_root
from baselines.belief.likelihood import HitModel, add_log_likelihood
from baselines.belief.resampling import effective_sample_size, systematic_indices
from baselines.policy import Belief
from osl_env.numerics import exp, normal, uniform
from osl_env.parameters import FloatArray

ROWS = 5  # x, y, z (m), weight, log weight
X, Y, Z, WEIGHT, LOG_WEIGHT = range(ROWS)
ROUGHENING_FLOOR = 1e-12  # m^2: a cloud that has collapsed stays collapsed, its kernel has no width


@njit(cache=True, error_model="numpy")
def draw_prior(cloud: FloatArray, area: FloatArray, random: NDArray[np.uint64]) -> None:
    """Fill `cloud` (5, n) with equally weighted particles, uniform over [0, `area`] (3,), m."""
    state = random[0]
    count = cloud.shape[1]
    for n in range(count):
        for axis in range(3):
            state, u = uniform(state)
            cloud[axis, n] = u * area[axis]
    cloud[WEIGHT] = 1.0 / count
    cloud[LOG_WEIGHT] = -math.log(count)
    random[0] = state


@njit(cache=True, error_model="numpy")
def normalise(cloud: FloatArray) -> float:
    """Make the weights of `cloud` (5, n) from its log weights, sum 1, and return their entropy, nats."""
    log_weight, weight = cloud[LOG_WEIGHT], cloud[WEIGHT]
    count = log_weight.shape[0]
    greatest = log_weight[0]
    for n in range(1, count):
        greatest = max(greatest, log_weight[n])
    for n in range(count):
        log_weight[n] = max(log_weight[n] - greatest, -700.0)  # a weight never becomes zero, nor its logarithm infinite
        weight[n] = exp(log_weight[n])
    total = 0.0
    for n in range(count):
        total += weight[n]
    log_total = math.log(total)
    entropy = 0.0
    for n in range(count):
        weight[n] /= total
        log_weight[n] -= log_total
        entropy -= weight[n] * log_weight[n]
    return entropy


@njit(cache=True, error_model="numpy")
def weigh(cloud: FloatArray, readings: FloatArray, powers: FloatArray, model: HitModel) -> float:
    """Bayes' rule on `cloud` (5, n) for `readings` (F, 6) to their `powers` (F,). Returns the entropy, nats."""
    for f in range(readings.shape[0]):
        add_log_likelihood(cloud[X], cloud[Y], cloud[Z], cloud[LOG_WEIGHT], readings[f], powers[f], model)
    return normalise(cloud)


@njit(cache=True, error_model="numpy")
def resample(source: FloatArray, target: FloatArray, random: NDArray[np.uint64]) -> None:
    """Draw the particles of `target` (5, m) from `source` (5, n) by systematic resampling; equal weights."""
    count = target.shape[1]
    chosen = np.empty(count, np.int64)
    random[0], u = uniform(random[0])
    systematic_indices(source[WEIGHT], u, chosen)
    drawn = np.empty((3, count))
    for axis in range(3):
        for n in range(count):
            drawn[axis, n] = source[axis, chosen[n]]
    target[:3] = drawn
    target[WEIGHT] = 1.0 / count
    target[LOG_WEIGHT] = -math.log(count)


@njit(cache=True, error_model="numpy")
def fill_normal(values: FloatArray, random: NDArray[np.uint64]) -> None:
    """Fill `values` (n,) with standard normal draws."""
    state = random[0]
    for n in range(values.shape[0]):
        state, values[n] = normal(state)
    random[0] = state


@njit(cache=True, error_model="numpy")
def roughen(
    cloud: FloatArray, gaussian: FloatArray, factor: float, area: FloatArray, random: NDArray[np.uint64]
) -> None:
    """Add Gaussian noise with `factor` times Silverman's bandwidth, shaped like `gaussian` (12,), to `cloud` (5, n)."""
    count = cloud.shape[1]
    root = np.empty((3, 3))
    triangular_root(gaussian, ROUGHENING_FLOOR, root)
    bandwidth = factor * (4.0 / (5.0 * count)) ** (1.0 / 7.0)
    noise = np.empty(3 * count)
    fill_normal(noise, random)
    for n in range(count):
        a, b, c = noise[3 * n], noise[3 * n + 1], noise[3 * n + 2]
        x = cloud[X, n] + bandwidth * root[0, 0] * a
        y = cloud[Y, n] + bandwidth * (root[1, 0] * a + root[1, 1] * b)
        z = cloud[Z, n] + bandwidth * (root[2, 0] * a + root[2, 1] * b + root[2, 2] * c)
        if 0.0 <= x <= area[0] and 0.0 <= y <= area[1] and 0.0 <= z <= area[2]:
            cloud[X, n], cloud[Y, n], cloud[Z, n] = x, y, z


@njit(cache=True, error_model="numpy")
def needs_resampling(cloud: FloatArray, resample_below: float) -> bool:
    """Whether the effective sample size is below that share of the count; always for a share of 1 or more."""
    return resample_below >= 1.0 or effective_sample_size(cloud[WEIGHT]) < resample_below * cloud.shape[1]


@njit(cache=True, error_model="numpy")
def bayes_update(
    cloud: FloatArray,
    readings: FloatArray,
    powers: FloatArray,
    model: HitModel,
    resample_below: float,
    roughening: float,
    area: FloatArray,
    gaussian: FloatArray,
    random: NDArray[np.uint64],
) -> float:
    """One update of `cloud` (5, n) (see the module); writes the fit to `gaussian` (12,). Returns the entropy, nats."""
    entropy = weigh(cloud, readings, powers, model)
    fit_gaussian(cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], gaussian)
    if needs_resampling(cloud, resample_below):
        resample(cloud, cloud, random)
        if roughening > 0.0:
            roughen(cloud, gaussian, roughening, area, random)
        fit_gaussian(cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], gaussian)
        entropy = math.log(cloud.shape[1])
    return entropy


class ParticleBelief:
    """Particles over the source's position, with their Gaussian fit. Starts uniform over the area [0, L], m.

    All draws come from `seed`.
    """

    __slots__ = ("area", "cloud", "entropy", "gaussian", "random")

    def __init__(self, count: int, area: FloatArray, seed: int) -> None:
        self.area = np.array(area, dtype=np.float64)
        self.cloud = np.empty((ROWS, count))
        self.gaussian = np.empty(GAUSSIAN_NUMBERS)
        self.random = np.array([seed], dtype=np.uint64)
        draw_prior(self.cloud, self.area, self.random)
        fit_gaussian(self.x, self.y, self.z, self.weights, self.gaussian)
        self.entropy = math.log(count)  # nats, of the weights (MUC-OSL eq 21)

    def update(
        self,
        readings: FloatArray,
        model: HitModel,
        *,
        powers: FloatArray | None = None,
        resample_below: float = 0.5,
        roughening: float = 0.0,
    ) -> None:
        """Bayes' rule for `readings` (F, 6) (`likelihood.READING_COLUMNS`), each to its power (F,), 1 by default.

        Resamples below an effective sample size of `resample_below` times the count (1: always), and then roughens with
        `roughening` times Silverman's bandwidth.
        """
        exponents = np.ones(len(readings)) if powers is None else powers
        self.entropy = bayes_update(
            self.cloud,
            readings,
            exponents,
            model,
            resample_below,
            roughening,
            self.area,
            self.gaussian,
            self.random,
        )

    @property
    def count(self) -> int:
        """Number of particles, n."""
        return int(self.cloud.shape[1])

    @property
    def x(self) -> FloatArray:
        """(n,) m."""
        row: FloatArray = self.cloud[X]
        return row

    @property
    def y(self) -> FloatArray:
        """(n,) m."""
        row: FloatArray = self.cloud[Y]
        return row

    @property
    def z(self) -> FloatArray:
        """(n,) m."""
        row: FloatArray = self.cloud[Z]
        return row

    @property
    def weights(self) -> FloatArray:
        """(n,), sum 1."""
        row: FloatArray = self.cloud[WEIGHT]
        return row

    @property
    def mean(self) -> FloatArray:
        """(3,) m."""
        mean: FloatArray = self.gaussian[:3]
        return mean

    @property
    def covariance(self) -> FloatArray:
        """(3, 3) m^2."""
        return self.gaussian[3:].reshape(3, 3)

    @property
    def spread(self) -> float:
        """Root of the covariance's trace, m."""
        g = self.gaussian
        return math.sqrt(max(g[3] + g[7] + g[11], 0.0))

    def as_belief(self) -> Belief:
        """A copy for metrics and pictures."""
        return Belief(
            mean=self.mean.copy(),
            covariance=self.covariance.copy(),
            particles=np.ascontiguousarray(self.cloud[:3].T),
            weights=self.weights.copy(),
        )
