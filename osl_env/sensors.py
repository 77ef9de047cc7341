"""What a UAV senses: hits of a counting gas sensor, and the wind.

Poisson counter (MUC-OSL eq 3): p(d) = (R dt)^d / d! * exp(-R dt) with R the plume's hit rate. The counter may miss
hits with a probability, count some that are none at a rate, and be blind for a dead time after each count
(non-paralysable); its mean then is (R (1 - miss) + false) dt, less the dead time's losses.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numba import njit

from osl_env.numerics import normal, poisson, uniform
from osl_env.parameters import Parameters, quantity
from osl_env.state import DETECTION_MEMORY


class PoissonCounter(Parameters):
    """Gas sensor that counts hits (MUC-OSL eq 3). The ideal counter is the default."""

    kind: Literal["poisson_counter"] = "poisson_counter"
    false_positive_rate: float = quantity(0.0, "1/s", ge=0)  # counts that are no hits
    miss_probability: float = quantity(0.0, "", ge=0, lt=1)  # of a hit that is not counted
    dead_time: float = quantity(0.0, "s", ge=0)  # blind time after each count


class Anemometer(Parameters):
    """Wind sensor: the wind's velocity with Gaussian noise on each horizontal component."""

    noise: float = quantity(0.0, "m/s", ge=0)  # standard deviation


@njit(cache=True, error_model="numpy")
def count_with_dead_time(stream: np.uint64, rate: float, duration: float, dead_time: float) -> tuple[np.uint64, int]:
    """The stream's new state and the counts in `duration` s of a counter at `rate` 1/s that is blind after each."""
    count = 0
    if rate <= 0.0:
        return stream, count
    stream, u = uniform(stream)
    time = -math.log(1.0 - u) / rate
    while time < duration:
        count += 1
        stream, u = uniform(stream)
        time += dead_time - math.log(1.0 - u) / rate
    return stream, count


@njit(inline="always", error_model="numpy")
def _remember(senses: Any, motion: Any, reading: Any, clock: Any) -> None:
    """Put a detection in front of the remembered ones."""
    for k in range(DETECTION_MEMORY - 1, 0, -1):
        senses.detection_time[k] = senses.detection_time[k - 1]
        senses.detection_reading[k] = senses.detection_reading[k - 1]
        for axis in range(3):
            senses.detection_position[k, axis] = senses.detection_position[k - 1, axis]
    senses.detection_time[0] = clock
    senses.detection_reading[0] = reading
    for axis in range(3):
        senses.detection_position[0, axis] = motion.position[axis]
    if senses.detections == 0:
        senses.first_detection_time = clock
    senses.detections += 1
    senses.fresh = True


@njit(inline="always", error_model="numpy")
def sample(m: Any, s: Any, episode: Any, c: Any, rate: float, sampling_time: float) -> None:
    """Sample gas and wind with one UAV whose leg (or period) has just ended.

    `rate` is the plume's hit rate, 1/s; a leg of n samples counts over n times `sampling_time`, s.
    """
    for axis in range(3):
        s.wind[axis] = episode.wind[axis]
    if c.wind_noise > 0.0:
        for axis in range(2):
            s.anemometer_stream, noise = normal(s.anemometer_stream)
            s.wind[axis] += c.wind_noise * noise
    if m.samples == 0:
        return
    duration = m.samples * sampling_time
    rate = rate * (1.0 - c.miss_probability) + c.false_positive_rate
    if c.dead_time > 0.0:
        s.gas_stream, hits = count_with_dead_time(s.gas_stream, rate, duration, c.dead_time)
    else:
        s.gas_stream, hits = poisson(s.gas_stream, rate * duration)
    s.reading = float(hits)
    s.sampling_time = duration
    if hits > 0:
        _remember(s, m, float(hits), episode.clock)
