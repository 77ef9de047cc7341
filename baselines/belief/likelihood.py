"""Likelihood of a reading given a source position: Poisson, with the mean of the advertised plume and sensor.

    p(d | o) = m^d / d! * exp(-m),   m = ((1 - miss) R(u | o) + false) * dt                 (MUC-OSL eqs 1 to 3)

with R the hit rate at the UAV's position u for a source at o, `miss` the counter's miss probability, `false` its false
positive rate and dt the sampling time. d = 0 is information: it counts like any other reading. A counter's dead time
is not modelled (at the paper's rates it loses few hits). The wind is what the anemometer has said so far, on average.

A sensor of concentration that reports counts (its `count_unit`; see `osl_env.sensors.concentration`) is interpreted by
the same law: the advertised plume then is the equivalent rate plume, R = mean concentration / count_unit. That is right
to second order where filaments pass independently; what lag, noise and threshold do to counts is not modelled. A count
that is at the sensor's greatest, K = max_count, says only that there were as many or more:

    p(K | o) = P(D >= K) = sum over d >= K of m^d / d! * exp(-m)

Expectations over counts to come (`information`, `grid_information`) leave the saturation out: merging outcomes only
loses information, so they are upper bounds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from baselines.policy import Briefing
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import hit_rate
from osl_env.radio import Message

READING_COLUMNS = 6  # a reading is one row: x, y, z (m), hits, sampling time (s), mission time (s)
LEAST_MEAN = 1e-300  # hits; keeps the logarithm of a mean finite

_LN2_HIGH = 6.93147180369123816490e-01  # ln 2 in two parts (Cody and Waite)
_LN2_LOW = 1.90821492927058770002e-10
_ROOT_HALF = np.uint64(0x3FE6A09E << 32)  # bits of about sqrt(1/2): mantissas are taken from [sqrt(1/2), sqrt(2))
_TO_ROOT_HALF = np.uint64((0x3FF00000 - 0x3FE6A09E) << 32)
_MANTISSA = np.uint64((1 << 52) - 1)
_U52 = np.uint64(52)
_TWO_52 = np.uint64(0x4330000000000000)  # bits of 2^52: or-ed with an integer below 2^52 they are 2^52 + that integer
_EXPONENT_BIAS = 4503599627370496.0 + 1023.0


class HitModel(NamedTuple):
    """The advertised plume and counter in the wind as measured: what the kernels need of them."""

    drift_x: float  # V_x / (2 D), 1/m
    drift_y: float  # V_y / (2 D), 1/m
    inverse_lambda: float  # 1/m
    strength: float  # a Q, m/s
    clamp_distance: float  # m
    background: float  # false positives, 1/s
    detection_probability: float  # 1 - miss probability
    max_count: float = math.inf  # hits, at which a reading saturates


def hit_model(plume: Any, gas_sensor: Any, wind_velocity: FloatArray) -> HitModel:
    """The model for hits of `gas_sensor` in `plume` and wind (3,) m/s. Raises InputError where there are no hits."""
    if plume.measures != "hit_rate":
        raise InputError(
            f"plume.measures = {plume.measures!r}: this policy's likelihood needs a plume of 'hit_rate' (for a plume of"
            " concentrations, an advertised_plume)"
        )
    if gas_sensor.reports != "hits":
        raise InputError(
            f"gas_sensor.kind = {gas_sensor.kind!r}: this policy's likelihood needs counts: a poisson_counter, or a"
            " count_unit"
        )
    east, north = float(wind_velocity[0]), float(wind_velocity[1])
    drift = plume.drift((east, north))
    return HitModel(
        drift_x=float(drift[0]),
        drift_y=float(drift[1]),
        inverse_lambda=float(plume.inverse_lambda((east * east + north * north) ** 0.5)),
        strength=float(plume.source_strength),
        clamp_distance=float(plume.clamp_distance),
        background=float(getattr(gas_sensor, "false_positive_rate", 0.0)),
        detection_probability=1.0 - float(getattr(gas_sensor, "miss_probability", 0.0)),
        max_count=float(getattr(gas_sensor, "max_count", None) or math.inf),
    )


class AdvertisedPlume:
    """The hit model in the mean of the winds measured so far; recomputed only when that mean changes."""

    __slots__ = ("_count", "_east", "_gas_sensor", "_north", "_plume", "model")

    model: HitModel

    def __init__(self, briefing: Briefing) -> None:
        self._plume, self._gas_sensor = briefing.plume, briefing.gas_sensor
        self._count, self._east, self._north = 0, 0.0, 0.0
        self.model = hit_model(self._plume, self._gas_sensor, np.zeros(3))

    def measure(self, wind: FloatArray) -> HitModel:
        """The model after one more wind measurement (3,), m/s."""
        east, north, _ = wind.tolist()
        self._count += 1
        if east != self._east or north != self._north:
            self._east += (east - self._east) / self._count  # a running mean: exact in a steady, noiseless wind
            self._north += (north - self._north) / self._count
            self.model = hit_model(self._plume, self._gas_sensor, np.array([self._east, self._north, 0.0]))
        return self.model


class ReadingTable:
    """The readings known at one decision as rows of `READING_COLUMNS`: the UAV's own, then those of its inbox."""

    __slots__ = ("_rows",)

    def __init__(self) -> None:
        self._rows = np.zeros((8, READING_COLUMNS))

    def gather(self, observation: Observation, inbox: Sequence[Message]) -> FloatArray:
        """(F, 6): x, y, z (m), hits, sampling time (s), mission time (s). One row a frame, the UAV's own first.

        Every frame keeps its row, so that weights of frames line up; where nothing was sampled the sampling time is 0
        and the reading says nothing. The array is reused at the next call.
        """
        count = 1 + len(inbox)
        if count > len(self._rows):
            self._rows = np.zeros((2 * count, READING_COLUMNS))
        rows = self._rows
        rows[0, :3] = observation.position
        rows[0, 3:] = observation.reading, observation.sampling_time, observation.time
        for f, frame in enumerate(inbox, start=1):
            rows[f, :3] = frame.position
            rows[f, 3:] = frame.reading, frame.sampling_time, frame.time
        return rows[:count]


@njit(inline="always", error_model="numpy")
def log(x: float) -> float:
    """Natural logarithm to 1 unit in the last place for finite x >= 1e-307. Vectorises (fdlibm's e_log polynomial)."""
    bits = np.float64(x).view(np.uint64) + _TO_ROOT_HALF
    k = np.uint64((bits >> _U52) | _TWO_52).view(np.float64) - _EXPONENT_BIAS
    f = np.uint64((bits & _MANTISSA) + _ROOT_HALF).view(np.float64) - 1.0
    s = f / (2.0 + f)
    z = s * s
    r = 1.531383769920937332e-01 + z * 1.479819860511658591e-01
    r = 2.222219843214978396e-01 + z * (1.818357216161805012e-01 + z * r)
    r = z * (6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * r)))
    h = 0.5 * f * f
    return k * _LN2_HIGH - ((h - (s * (h + r) + k * _LN2_LOW)) - f)


@njit(inline="always", error_model="numpy")
def hits_per_second(dx: float, dy: float, dz: float, model: HitModel) -> float:
    """Mean counts, 1/s, at the offset (dx, dy, dz) = u - o, m, from a source."""
    rate = hit_rate(
        dx, dy, dz, model.drift_x, model.drift_y, model.inverse_lambda, model.strength, model.clamp_distance
    )
    return model.detection_probability * rate + model.background


@njit(cache=True, error_model="numpy")
def log_saturated(count: float, mean: float) -> float:
    """ln( count! P(D >= count) ) of a Poisson D with `mean` > 0: the log likelihood of a saturated reading.

    Times count!, as other readings leave out log d!: for a small mean both agree.
    """
    if mean < count + 1.0:  # count! P(D >= count) = m^count exp(-m) (1 + m / (count + 1) + ..): nothing cancels
        total = term = 1.0
        d = count
        while term > 1e-17 * total:
            d += 1.0
            term *= mean / d
            total += term
        return count * math.log(mean) - mean + math.log(total)
    log_factorial = math.lgamma(count + 1.0)
    total, term, d = 1.0, 1.0, count - 1.0  # P(D < count), at most about a half, in terms of P(D = count - 1)
    while d > 0.0 and term > 1e-17 * total:
        term *= d / mean
        total += term
        d -= 1.0
    below = math.exp((count - 1.0) * math.log(mean) - mean - math.lgamma(count)) * total
    return log_factorial + math.log1p(-below)


@njit(cache=True, error_model="numpy")
def add_log_likelihood(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    log_weight: FloatArray,
    reading: FloatArray,
    power: float,
    model: HitModel,
) -> None:
    """Add `power` times the log likelihood of `reading` (6,) to `log_weight` (n,), for sources at x, y, z (n,), m.

    The constant log d! is left out.
    """
    ux, uy, uz, hits, sampling_time = reading[0], reading[1], reading[2], reading[3], reading[4]
    if sampling_time <= 0.0 or power == 0.0:
        return
    if hits == 0.0:  # a pass of its own: most readings are zero and need no logarithm
        for n in range(x.shape[0]):
            mean = hits_per_second(ux - x[n], uy - y[n], uz - z[n], model) * sampling_time
            log_weight[n] -= power * mean
        return
    if hits >= model.max_count:
        for n in range(x.shape[0]):
            mean = hits_per_second(ux - x[n], uy - y[n], uz - z[n], model) * sampling_time
            log_weight[n] += power * log_saturated(hits, max(mean, LEAST_MEAN))
        return
    for n in range(x.shape[0]):
        mean = hits_per_second(ux - x[n], uy - y[n], uz - z[n], model) * sampling_time
        mean = max(mean, LEAST_MEAN)
        log_weight[n] += power * (hits * log(mean) - mean)
