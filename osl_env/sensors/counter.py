"""A gas sensor that counts hits.

Poisson counter (MUC-OSL eq 3): p(d) = (R dt)^d / d! * exp(-R dt) with R the plume's hit rate. The counter may miss
hits with a probability, count some that are none at a rate, and be blind for a dead time after each count
(non-paralysable); its mean then is (R (1 - miss) + false) dt, less the dead time's losses.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np
from numba import njit

from osl_env.numerics import poisson, uniform
from osl_env.parameters import quantity
from osl_env.sensors.base import HITS_SCALE, GasSensor, remember
from osl_env.sensors.faults import faulty_reading


class PoissonCounter(GasSensor):
    """Gas sensor that counts hits (MUC-OSL eq 3). The ideal counter is the default."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "hit_rate"

    kind: Literal["poisson_counter"] = "poisson_counter"
    false_positive_rate: float = quantity(0.0, "1/s", ge=0)  # counts that are no hits
    miss_probability: float = quantity(0.0, "", ge=0, lt=1)  # of a hit that is not counted
    dead_time: float = quantity(0.0, "s", ge=0)  # blind time after each count

    @property
    def reports(self) -> Literal["hits", "concentration"]:
        """Hits."""
        return "hits"

    @property
    def scale(self) -> float:
        """5 hits."""
        return HITS_SCALE

    @property
    def period(self) -> float:
        """Infinite: a counter asks for no ticks of its own, it counts over the sampling time at its end."""
        return math.inf


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
def sample(m: Any, s: Any, episode: Any, c: Any, rate: float, faults: Any, uav: int, sampling_time: float) -> None:
    """Count hits with UAV number `uav` whose leg (or period) has just ended.

    `rate` is the plume's hit rate, 1/s; a leg of n samples counts over n times `sampling_time`, s.
    """
    if m.samples == 0:
        return
    duration = m.samples * sampling_time
    rate = rate * (1.0 - c.miss_probability) + c.false_positive_rate
    if c.dead_time > 0.0:
        s.gas_stream, hits = count_with_dead_time(s.gas_stream, rate, duration, c.dead_time)
    else:
        s.gas_stream, hits = poisson(s.gas_stream, rate * duration)
    count = float(hits)
    if faults is not None:
        count = faulty_reading(faults, uav, episode.clock, count, s.reading, s.gas_stream)
        count = math.floor(max(count, 0.0) + 0.5)
    if s.dead:
        count = 0.0
    s.reading = count
    s.sampling_time = duration
    if count > 0.0:
        remember(s, m, count, episode.clock)
