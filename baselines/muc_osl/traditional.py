"""The traditional particle filter of Col-Inf and Adap-PP: fixed N, every reading at full weight, resampling on ESS.

All neighbours' measurements are used as if they were the UAV's own (beta = 1). Col-Inf shares particles too (4 numbers
each); the paper does not say what is done with them. Here they are pooled: when the filter resamples, it draws its N
particles from the equal mixture of its own cloud and its neighbours' newest ones, each weighted by the readings that
came after it was sent. A mixture (linear opinion pool) is used, not a product: the clouds rest on shared readings, and
a product would count those twice. `share_particles = False` shares the measurements alone.

There is no roughening unless `roughening` > 0: with a hundred particles the cloud then collapses onto a few points,
which is what the roughened variants (`col-inf-roughened`, `adap-pp-roughened`) are there to show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.gaussian_fit import fit_gaussian
from baselines.belief.likelihood import HitModel, add_log_likelihood
from baselines.belief.particle_filter import (
    LOG_WEIGHT,
    ROWS,
    WEIGHT,
    ParticleBelief,
    X,
    Y,
    Z,
    needs_resampling,
    normalise,
    resample,
    roughen,
)
from baselines.muc_osl.messages import pack_particles, unpack_particles
from baselines.policy import Briefing
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.radio import Message

_TIME_SLACK = 1e-9  # s: a reading of the same instant as a cloud came after it, for a cloud is sent before its update
_LEAST_WEIGHT = 1e-30


class TraditionalFilterParameters(Parameters):
    """Parameters of `TraditionalFilter`."""

    particles: int = quantity(100, "", ge=2, le=100_000)  # N (Table 1)
    resample_below: float = quantity(0.5, "", ge=0, le=1)  # effective sample size over N; 1: at every iteration
    roughening: float = quantity(0.0, "", ge=0)  # times Silverman's bandwidth, after resampling
    share_particles: bool = False  # send all particles, and pool those of the neighbours


@njit(cache=True, error_model="numpy")
def pool_clouds(
    own: FloatArray,
    raw: FloatArray,
    particles: NDArray[np.float32],
    sent: FloatArray,
    sizes: NDArray[np.int64],
    readings: FloatArray,
    model: HitModel,
) -> FloatArray:
    """The mixture (5, n + m) of the `own` cloud (5, n) and the neighbours' `particles` (m, 4) of S clouds.

    `raw` (n,) are the own log weights with the readings' likelihood, before normalising: clouds that explain the
    readings better get more of the mixture. A neighbour's cloud is weighted by the readings since it was `sent` (S,),
    s.
    """
    count = own.shape[1]
    pool = np.empty((ROWS, count + particles.shape[0]))
    pool[:3, :count] = own[:3]
    pool[LOG_WEIGHT, :count] = raw
    first = count
    for s in range(sent.shape[0]):
        size = sizes[s]
        last = first + size
        for n in range(size):
            particle = particles[first - count + n]
            for axis in range(3):
                pool[axis, first + n] = particle[axis]
            pool[LOG_WEIGHT, first + n] = math.log(max(float(particle[3]), _LEAST_WEIGHT))
        x, y, z, log_weight = (
            pool[X, first:last],
            pool[Y, first:last],
            pool[Z, first:last],
            pool[LOG_WEIGHT, first:last],
        )
        for f in range(readings.shape[0]):
            if readings[f, 5] >= sent[s] - _TIME_SLACK:
                add_log_likelihood(x, y, z, log_weight, readings[f], 1.0, model)
        first = last
    normalise(pool)
    return pool


@njit(cache=True, error_model="numpy")
def traditional_update(
    cloud: FloatArray,
    particles: NDArray[np.float32],
    sent: FloatArray,
    sizes: NDArray[np.int64],
    readings: FloatArray,
    model: HitModel,
    resample_below: float,
    roughening: float,
    area: FloatArray,
    gaussian: FloatArray,
    random: NDArray[np.uint64],
) -> float:
    """Bayes, resampling from the pool, roughening and fit of `cloud` (5, n). Returns the entropy, nats."""
    for f in range(readings.shape[0]):
        add_log_likelihood(cloud[X], cloud[Y], cloud[Z], cloud[LOG_WEIGHT], readings[f], 1.0, model)
    raw = cloud[LOG_WEIGHT].copy()
    entropy = normalise(cloud)
    if needs_resampling(cloud, resample_below):
        pool = pool_clouds(cloud, raw, particles, sent, sizes, readings, model)
        fit_gaussian(pool[X], pool[Y], pool[Z], pool[WEIGHT], gaussian)
        resample(pool, cloud, random)
        if roughening > 0.0:
            roughen(cloud, gaussian, roughening, area, random)
        entropy = math.log(cloud.shape[1])
    fit_gaussian(cloud[X], cloud[Y], cloud[Z], cloud[WEIGHT], gaussian)
    return entropy


class TraditionalFilter:
    """Estimator: particle filter with a fixed number of particles (see the module)."""

    __slots__ = ("_parameters", "belief")

    def __init__(self, parameters: TraditionalFilterParameters, briefing: Briefing) -> None:
        self._parameters = parameters
        self.belief = ParticleBelief(parameters.particles, briefing.area, briefing.seed)

    def message(self) -> bytes | None:
        """All particles (16 bytes each) if they are shared; a frame's header holds the measurement."""
        return pack_particles(self.belief.cloud) if self._parameters.share_particles else None

    def update(self, readings: FloatArray, inbox: Sequence[Message], model: HitModel) -> None:
        """Take in `readings` (F, 6), the UAV's own first and then those of `inbox`, and the neighbours' particles."""
        parameters, belief = self._parameters, self.belief
        particles, sent, sizes = unpack_particles(inbox if parameters.share_particles else ())
        belief.entropy = traditional_update(
            belief.cloud,
            particles,
            sent,
            sizes,
            readings,
            model,
            parameters.resample_below,
            parameters.roughening,
            belief.area,
            belief.gaussian,
            belief.random,
        )
