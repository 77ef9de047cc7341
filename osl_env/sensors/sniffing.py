"""The kernels of sensors of concentration, batched over worlds (see `osl_env.sensors.concentration`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.numerics import exp, normal, uniform
from osl_env.parameters import FloatArray
from osl_env.sensors.base import remember
from osl_env.sensors.faults import faulty_reading
from osl_env.state import BoolArray, IntArray, StateArray
from osl_env.streams import Purpose, derive

_SENSOR = int(Purpose.SENSOR)
_NOTHING = 1e-200  # a level below it is 0: its decay would end in slow subnormal numbers

SNIFFER = np.dtype(  # (n_envs, n_uavs)
    [
        ("level", np.float64),  # the lagged concentration
        ("baseline", np.float64),  # what the drift adds
        ("total", np.float64),  # of the outputs in the present sampling time
        ("count", np.int64),  # of them
        ("output", np.float64),  # the last one
        ("stream", np.uint64),
    ],
    align=True,
)


@njit(cache=True, error_model="numpy")
def begin_sniffers(sniffers: StateArray, rows: IntArray, seeds: IntArray) -> None:
    """Sensors in clean air, with fresh streams, in the worlds `rows` for the episodes with `seeds`."""
    for k in range(rows.size):
        for i in range(sniffers.shape[1]):
            sniffer = sniffers[rows[k], i]
            sniffer.level = sniffer.baseline = sniffer.total = sniffer.output = 0.0
            sniffer.count = 0
            sniffer.stream = derive(seeds[k], _SENSOR, i)


@njit(inline="always", error_model="numpy")
def _gain(dt: float, time_constant: float) -> float:
    """The share of a step that a first-order lag has made after `dt`."""
    return 1.0 - exp(-dt / time_constant) if time_constant > 0.0 else 1.0


@njit(cache=True, error_model="numpy")
def sniff(
    sniffers: StateArray,
    response: StateArray,
    due: BoolArray,
    gives: BoolArray,
    sampling: BoolArray,
    dt: float,
    concentration: FloatArray,
) -> None:
    """One tick of `dt` s in the worlds of `due` (n_envs,), with the true `concentration` (n_envs, n_uavs) during it.

    In the worlds of `gives` (n_envs,) it ends with an output, in the others the last one holds. Where `sampling`
    (n_envs, n_uavs), the output belongs to the present sampling time.
    """
    r = response[0]
    rise, recovery = _gain(dt, r.rise_time), _gain(dt, r.recovery_time)
    noise = math.sqrt(min(r.period / dt, 1.0))  # of the mean of the outputs in a tick
    drift = r.drift * math.sqrt(dt)
    noisy = r.noise > 0.0 or r.relative_noise > 0.0
    for e in range(sniffers.shape[0]):
        if not due[e]:
            continue
        for i in range(sniffers.shape[1]):
            sniffer = sniffers[e, i]
            c = concentration[e, i]
            gain = rise if c > sniffer.level else recovery
            sniffer.level = c if gain == 1.0 else sniffer.level + gain * (c - sniffer.level)
            if sniffer.level < _NOTHING:
                sniffer.level = 0.0
            if drift > 0.0:
                sniffer.stream, step = normal(sniffer.stream)
                sniffer.baseline += drift * step
            if not gives[e]:
                continue
            output = sniffer.level + sniffer.baseline
            if noisy:
                sniffer.stream, draw = normal(sniffer.stream)
                output += noise * math.hypot(r.noise, r.relative_noise * sniffer.level) * draw
            sniffer.output = min(output, r.full_scale)
            if sampling[e, i]:
                sniffer.total += sniffer.output
                sniffer.count += 1


@njit(inline="always", error_model="numpy")
def sample_concentration(
    m: Any,
    s: Any,
    sniffer: Any,
    episode: Any,
    response: Any,
    faults: Any,
    uav: int,
    sampling_time: float,
) -> None:
    """Read the sensor of UAV number `uav` whose leg (or period) has just ended; a new sampling time begins.

    A leg of n samples has a sampling time of n times `sampling_time`, s. If no output fell into it, the last one holds.
    """
    if m.samples == 0:
        return
    duration = m.samples * sampling_time
    reading = sniffer.total / sniffer.count if sniffer.count > 0 else sniffer.output
    sniffer.total = 0.0
    sniffer.count = 0
    reading = max(reading, 0.0)
    if response.resolution > 0.0:
        reading = math.floor(reading / response.resolution + 0.5) * response.resolution
    threshold, limit = response.threshold, response.full_scale
    if response.count_unit > 0.0:
        sniffer.stream, dither = uniform(sniffer.stream)
        counted = reading if reading > threshold else 0.0
        threshold, limit = 0.0, response.max_count
        reading = min(math.floor(counted * duration / response.count_unit + dither), limit)
    if faults is not None:
        reading = faulty_reading(faults, uav, episode.clock, reading, s.reading, sniffer.stream)
        if response.count_unit > 0.0:
            reading = math.floor(reading + 0.5)
        reading = min(max(reading, 0.0), limit)
    if s.dead:
        reading = 0.0
    s.reading = reading
    s.sampling_time = duration
    if reading > threshold:
        remember(s, m, reading, episode.clock)
