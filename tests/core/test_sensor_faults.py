"""Faults of both kinds of gas sensor, the anemometer in a local wind, range sensors. Tolerance: 5 standard errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit
from pydantic import ValidationError
from test_concentration_sensors import Rig

from osl_env.numerics import poisson
from osl_env.parameters import FloatArray
from osl_env.sensors import (
    IdealSensor,
    PoissonCounter,
    RangeSensors,
    SensorFault,
    add_range_noise,
    begin_range_streams,
    fault_table,
    measure_wind,
    sample,
)
from osl_env.state import CONSTANTS, EPISODE, MOTION, SENSES
from osl_env.streams import Purpose, derive

SIGMAS = 5.0


@njit
def _count_all(motion: Any, senses: Any, episode: Any, c: Any, rate: float, faults: Any) -> None:
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            senses[e, i].fresh = False
            sample(motion[e, i], senses[e, i], episode[e], c[0], rate, faults, i, 1.0)


@njit
def _measure_all(senses: Any, c: Any, winds: FloatArray) -> None:
    for e in range(senses.shape[0]):
        for i in range(senses.shape[1]):
            measure_wind(senses[e, i], c[0], winds[e, i, 0], winds[e, i, 1], winds[e, i, 2])


def counts(faults: list[SensorFault], n_envs: int = 1, n: int = 8, rate: float = 3.0) -> tuple[FloatArray, Any]:
    """(n, n_envs, 2) readings of ideal counters at the clock times 0, 1, .., and the senses after them."""
    shape = (n_envs, 2)
    motion, senses, episode = np.zeros(shape, MOTION), np.zeros(shape, SENSES), np.zeros(n_envs, EPISODE)
    motion["samples"] = 1
    for e in range(n_envs):
        for i in range(2):
            senses[e, i]["gas_stream"] = derive(e, Purpose.SENSOR, i)
    readings = np.empty((n, *shape))
    for k in range(n):
        episode["clock"] = k
        _count_all(motion, senses, episode, np.zeros(1, CONSTANTS), rate, fault_table(faults))
        readings[k] = senses["reading"]
    return readings, senses


def concentrations(faults: list[SensorFault], n_envs: int = 1, n: int = 8, **changes: Any) -> FloatArray:
    """(n, n_envs, 2) readings at the clock times 1, 2, .. of a concentration that is 1 plus the time."""
    rig = Rig(IdealSensor(**changes), n_envs, 2)
    return np.array([rig.smell(1.0 + k, 1.0).read(faults=fault_table(faults)) for k in range(1, n + 1)])


def test_without_faults_a_count_is_the_streams_poisson_draw() -> None:
    readings, _ = counts([])
    for uav in range(2):
        stream = np.uint64(derive(0, Purpose.SENSOR, uav))
        for reading in readings[:, 0, uav]:
            state, hits = poisson(stream, 3.0)
            stream = np.uint64(state)
            assert reading == hits


def test_a_dead_counter_counts_nothing_and_detects_nothing() -> None:
    whole, _ = counts([], n=40)
    faulty, senses = counts([SensorFault(kind="dead", uav=1, start=10.0, end=20.0)], n=40)
    assert np.array_equal(faulty[:, :, 0], whole[:, :, 0])
    assert not faulty[10:20, :, 1].any()
    rest = np.r_[0:10, 20:40]
    assert np.array_equal(faulty[rest, :, 1], whole[rest, :, 1])  # over, as if it had not been
    assert senses["detections"].tolist() == np.count_nonzero(faulty, axis=0).tolist()


@pytest.mark.parametrize("kind", ["dead", "stuck", "bias", "gain", "noise"])
def test_a_fault_is_bounded_in_time_and_concerns_its_uav(kind: str) -> None:
    fault = SensorFault.model_validate({"kind": kind, "uav": 0, "start": 3.0, "end": 6.0, "magnitude": 2.5})
    whole, faulty = concentrations([]), concentrations([fault])
    during = np.array([False, False, True, True, True, False, False, False])  # at 3, 4 and 5 s; 6 s is after it
    assert np.array_equal(faulty[:, 0, 1], whole[:, 0, 1])
    assert np.array_equal(faulty[~during, 0, 0], whole[~during, 0, 0])
    assert np.all(faulty[during, 0, 0] != whole[during, 0, 0])


def test_what_faults_do() -> None:
    whole = concentrations([])[:, 0, 0]
    assert whole == pytest.approx(np.arange(2.0, 10.0))
    faults = {
        kind: concentrations([SensorFault.model_validate({"kind": kind, "start": 4.0, "magnitude": 1.5})])[:, 0, 0]
        for kind in ("dead", "stuck", "bias", "gain")
    }
    assert faults["dead"][3:].tolist() == [0.0] * 5
    assert faults["stuck"][3:].tolist() == [whole[2]] * 5
    assert faults["bias"][3:] == pytest.approx(whole[3:] + 1.5)
    assert faults["gain"][3:] == pytest.approx(whole[3:] * 1.5)
    both = [SensorFault(kind="gain", magnitude=2.0), SensorFault(kind="bias", magnitude=-1.0)]
    assert concentrations(both)[:, 0, 0] == pytest.approx(2.0 * whole - 1.0)
    assert concentrations(both[::-1])[:, 0, 0] == pytest.approx(2.0 * (whole - 1.0))


def test_faulty_readings_stay_in_range_and_counts_stay_whole() -> None:
    assert concentrations([SensorFault(kind="bias", magnitude=-50.0)]).max() == 0.0
    assert concentrations([SensorFault(kind="gain", magnitude=50.0)], full_scale=30.0).max() == 30.0
    for fault in (SensorFault(kind="noise", magnitude=3.3), SensorFault(kind="gain", magnitude=0.3)):
        for readings in (counts([fault], 50)[0], concentrations([fault], 50, count_unit=1.0, max_count=7)):
            assert np.array_equal(readings, np.round(readings))
            assert readings.min() >= 0.0
    assert concentrations([SensorFault(kind="bias", magnitude=9.0)], count_unit=1.0, max_count=7).max() == 7.0


def test_noise_of_a_fault_is_gaussian_and_fresh_for_each_uav_and_time() -> None:
    noise = concentrations([SensorFault(kind="noise", magnitude=0.1)], 800) - concentrations([], 800)
    assert abs(noise.mean()) < SIGMAS * 0.1 / math.sqrt(noise.size)
    assert abs(noise.std() - 0.1) < SIGMAS * 0.1 / math.sqrt(2 * noise.size)
    # an ideal sensor draws nothing itself, so its faults would repeat if they depended on its stream alone
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < SIGMAS / math.sqrt(noise[0].size)
    assert abs(np.corrcoef(noise[:, :, 0].ravel(), noise[:, :, 1].ravel())[0, 1]) < SIGMAS / math.sqrt(noise.size / 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": 5.0, "end": 5.0}, "end = 5: must be later than start = 5"),
        ({"kind": "noise", "magnitude": -1.0}, "magnitude = -1: must be at least 0"),
        ({"kind": "broken"}, "Input should be"),
        ({"uav": -1}, "greater than or equal to 0"),
    ],
)
def test_bad_faults_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SensorFault.model_validate(changes)


def test_the_anemometer_measures_the_local_wind() -> None:
    n = 3000
    senses, c, winds = np.zeros((n, 2), SENSES), np.zeros(1, CONSTANTS), np.zeros((n, 2, 3))
    winds[:, 0], winds[:, 1] = (1.0, -2.0, 0.5), (0.0, 3.0, -0.25)
    _measure_all(senses, c, winds)
    assert np.array_equal(senses["wind"], winds)
    c["wind_noise"] = 0.3
    for e in range(n):
        for i in range(2):
            senses[e, i]["anemometer_stream"] = derive(e, Purpose.ANEMOMETER, i)
    _measure_all(senses, c, winds)
    noise = senses["wind"] - winds
    assert not noise[:, :, 2].any()
    assert np.all(np.abs(noise[:, :, :2].mean(axis=0)) < SIGMAS * 0.3 / math.sqrt(n))
    assert np.all(np.abs(noise[:, :, :2].std(axis=0) - 0.3) < SIGMAS * 0.3 / math.sqrt(2 * n))


def test_range_noise_spares_what_is_out_of_range_and_does_not_depend_on_it() -> None:
    n, longest, noise = 2000, 4.0, 0.1
    streams = np.zeros((n, 2), np.uint64)
    begin_range_streams(streams, np.arange(n), np.arange(n))
    again, looking = streams.copy(), np.ones((n, 2), np.bool_)
    looking[0] = False
    near, mixed = np.full((n, 2, 3), 2.0), np.full((n, 2, 3), 2.0)
    mixed[:, :, 1] = longest
    add_range_noise(streams, looking, noise, longest, near)
    add_range_noise(again, looking, noise, longest, mixed)
    assert np.all(near[0] == 2.0)
    assert np.all(mixed[:, :, 1] == longest)
    assert np.array_equal(mixed[:, :, ::2], near[:, :, ::2])
    errors = near[1:] - 2.0
    assert abs(errors.mean()) < SIGMAS * noise / math.sqrt(errors.size)
    assert abs(errors.std() - noise) < SIGMAS * noise / math.sqrt(2 * errors.size)
    edge = np.full((n, 2, 3), 0.01)
    edge[:, :, 0] = longest - 0.01
    add_range_noise(streams, looking, noise, longest, edge)
    assert edge.min() == 0.0
    assert edge.max() == longest


def test_counters_and_range_sensors_say_what_they_are() -> None:
    counter = PoissonCounter()
    assert (counter.measures, counter.reports, counter.scale) == ("hit_rate", "hits", 5.0)
    assert RangeSensors().count == 0
