"""Sensors of concentration against their laws: lag, noise, drift, range, counts. Tolerance: 5 standard errors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit
from pydantic import ValidationError

from osl_env.parameters import FloatArray
from osl_env.sensors import (
    SNIFFER,
    ConcentrationSensor,
    IdealSensor,
    MoxSensor,
    PidSensor,
    begin_sniffers,
    fault_table,
    sample_concentration,
    sniff,
)
from osl_env.state import EPISODE, MOTION, SENSES, StateArray

SIGMAS = 5.0
SENSORS: list[type[ConcentrationSensor]] = [IdealSensor, PidSensor, MoxSensor]
NO_FAULTS = fault_table([])


@njit
def _sample_all(
    motion: Any, senses: Any, sniffers: Any, episode: Any, response: Any, faults: Any, sampling_time: float
) -> None:
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            senses[e, i].fresh = False
            sample_concentration(
                motion[e, i], senses[e, i], sniffers[e, i], episode[e], response[0], faults, i, sampling_time
            )


class Rig:
    """`n_uavs` UAVs with `sensor` in each of `n_envs` worlds, without the worlds."""

    def __init__(self, sensor: ConcentrationSensor, n_envs: int = 1, n_uavs: int = 1, seed: int = 0) -> None:
        shape = (n_envs, n_uavs)
        self.response = sensor.response()
        self.motion, self.senses = np.zeros(shape, MOTION), np.zeros(shape, SENSES)
        self.sniffers, self.episode = np.zeros(shape, SNIFFER), np.zeros(n_envs, EPISODE)
        self.motion["samples"] = 1
        begin_sniffers(self.sniffers, np.arange(n_envs), np.arange(seed, seed + n_envs))

    def smell(self, concentration: float | FloatArray, duration: float, dt: float = 0.1, counts: bool = True) -> Rig:
        """Smell a constant `concentration` for `duration` s; the outputs belong to a sampling time where `counts`."""
        shape = self.sniffers.shape
        field = np.ascontiguousarray(np.broadcast_to(np.asarray(concentration, dtype=np.float64), shape))
        due, sampling = np.ones(shape[0], np.bool_), np.full(shape, counts)
        for _ in range(round(duration / dt)):
            sniff(self.sniffers, self.response, due, due, sampling, dt, field)
        self.episode["clock"] += duration
        return self

    def read(self, sampling_time: float = 1.0, faults: StateArray = NO_FAULTS) -> FloatArray:
        """(n_envs, n_uavs): the readings at the end of a sampling time."""
        _sample_all(self.motion, self.senses, self.sniffers, self.episode, self.response, faults, sampling_time)
        return np.array(self.senses["reading"])

    @property
    def output(self) -> FloatArray:
        """(n_envs, n_uavs): the last outputs."""
        return np.array(self.sniffers["output"])


def quiet(sensor: type[ConcentrationSensor], **changes: Any) -> ConcentrationSensor:
    return sensor(**{"noise": 0.0, "drift": 0.0, **changes})


def standard_error_of_variance(values: FloatArray) -> float:
    deviations = values - values.mean()
    return math.sqrt(max(float(np.mean(deviations**4)) - float(values.var()) ** 2, 0.0) / values.size)


@pytest.mark.parametrize("sensor", [PidSensor, MoxSensor])
@pytest.mark.parametrize("dt", [0.05, 0.1, 0.5, 2.5])
def test_a_step_rises_and_falls_with_the_time_constants(sensor: type[ConcentrationSensor], dt: float) -> None:
    model = quiet(sensor)
    rig = Rig(model).smell(8.0, 5.0, dt)
    risen = 8.0 * (1.0 - math.exp(-5.0 / model.rise_time))
    assert rig.output[0, 0] == pytest.approx(risen, rel=1e-12)
    rig.smell(2.0, 2.5, dt)
    assert rig.output[0, 0] == pytest.approx(2.0 + (risen - 2.0) * math.exp(-2.5 / model.recovery_time), rel=1e-12)


def test_a_mox_sensor_is_slower_to_recover_than_to_rise_and_a_pid_is_faster_than_both() -> None:
    mox, pid = MoxSensor(), PidSensor()
    assert pid.rise_time == pid.recovery_time < mox.rise_time < mox.recovery_time / 5
    assert mox.period == 0.1
    assert PidSensor().rise_time * math.log(10) == pytest.approx(3.0, rel=0.01)  # 90 % within 3 s


def test_the_ideal_sensor_reads_the_concentration_and_nothing_after_it_has_gone() -> None:
    field = np.array([[0.1, 1 / 3], [7.7, 0.0]])
    rig = Rig(IdealSensor(), 2, 2).smell(field, 0.1)
    assert np.array_equal(rig.read(0.1), field)
    assert not rig.smell(0.0, 0.1).read(0.1).any()


def test_a_level_that_decays_ends_at_zero() -> None:
    rig = Rig(quiet(PidSensor)).smell(5.0, 10.0).smell(0.0, 700.0, 0.5)
    assert rig.output[0, 0] == 0.0


@pytest.mark.parametrize("dt", [0.05, 0.1, 0.2, 0.5])
def test_noise_of_a_reading_is_that_of_its_outputs_mean_whatever_the_tick(dt: float) -> None:
    n, noise, level = 4000, 0.4, 20.0
    rig = Rig(IdealSensor(noise=noise, relative_noise=0.03), n)
    if dt == 0.05:  # half the sensor's period: every other tick gives an output
        for _ in range(10):
            rig.smell(level, dt, dt, counts=False).smell(level, dt, dt)
    else:
        rig.smell(level, 1.0, dt)
    readings = rig.read()
    expected = math.hypot(noise, 0.03 * level) / math.sqrt(10)
    assert abs(readings.mean() - level) < SIGMAS * expected / math.sqrt(n)
    assert abs(readings.std() - expected) < SIGMAS * expected / math.sqrt(2 * n)


@pytest.mark.parametrize("dt", [0.1, 0.4])
def test_drift_is_a_random_walk(dt: float) -> None:
    n, drift = 3000, 0.3
    rig = Rig(IdealSensor(drift=drift), n, 2)
    for _ in range(4):
        before = rig.sniffers["baseline"].copy()
        clock = float(rig.episode["clock"][0])
        baseline = rig.smell(0.0, 2.0, dt).sniffers["baseline"]
        expected = drift**2 * (clock + 2.0)
        assert abs(baseline.var() - expected) < SIGMAS * expected * math.sqrt(2 / baseline.size)
        assert abs(baseline.mean()) < SIGMAS * math.sqrt(expected / baseline.size)
        step = baseline - before
        if before.any():
            assert abs(np.corrcoef(step.ravel(), before.ravel())[0, 1]) < SIGMAS / math.sqrt(step.size)
        assert abs(np.corrcoef(baseline[:, 0], baseline[:, 1])[0, 1]) < SIGMAS / math.sqrt(n)


def test_outputs_saturate_readings_do_not_go_below_zero_and_noise_does_not_shift_a_mean() -> None:
    rig = Rig(quiet(PidSensor, full_scale=10.0)).smell(50.0, 5.0, counts=False).smell(50.0, 1.0)
    assert rig.read()[0, 0] == 10.0
    rig = Rig(IdealSensor(noise=1.0), 2000).smell(0.0, 1.0)
    assert rig.output.min() < 0.0
    total = rig.sniffers["total"] / 10
    assert abs(total.mean()) < SIGMAS * math.sqrt(0.1 / total.size)
    assert rig.read().min() == 0.0


def test_readings_are_rounded_to_the_resolution() -> None:
    field = np.linspace(0.0, 3.0, 301)[None, :]
    rig = Rig(IdealSensor(resolution=0.25), 1, 301)
    readings = rig.smell(field, 1.0).read()
    assert np.abs(readings - field).max() <= 0.125 + 1e-9
    assert np.array_equal(np.unique(readings), np.arange(13) * 0.25)


def test_a_detection_is_a_reading_above_the_threshold() -> None:
    rig = Rig(IdealSensor(threshold=2.0), 1, 3)
    rig.motion["position"] = np.arange(9.0).reshape(1, 3, 3)
    readings = rig.smell(np.array([[1.0, 2.0, 2.5]]), 1.0).read()
    assert readings.tolist() == [[1.0, 2.0, 2.5]]
    assert rig.senses["fresh"].tolist() == [[False, False, True]]
    assert rig.senses["detections"].tolist() == [[0, 0, 1]]
    assert rig.senses["detection_reading"][0, 2, 0] == 2.5
    assert rig.senses["detection_time"][0, 2, 0] == rig.senses["first_detection_time"][0, 2] == 1.0
    assert rig.senses["detection_position"][0, 2, 0].tolist() == [6.0, 7.0, 8.0]


def test_a_reading_is_the_mean_over_its_own_sampling_time() -> None:
    rig = Rig(IdealSensor())
    rig.smell(9.0, 1.0, counts=False).smell(1.0, 0.5).smell(3.0, 0.5)
    assert rig.read()[0, 0] == pytest.approx(2.0)
    rig.motion["samples"] = 3
    assert rig.smell(5.0, 3.0).read()[0, 0] == pytest.approx(5.0)
    assert rig.senses["sampling_time"][0, 0] == 3.0
    rig.motion["samples"] = 0  # interrupted before the first sample was complete
    assert rig.smell(8.0, 0.2).read()[0, 0] == pytest.approx(5.0)
    rig.motion["samples"] = 1
    rig.sniffers["total"], rig.sniffers["count"] = 0.0, 0
    assert rig.smell(4.0, 0.5, counts=False).read()[0, 0] == 4.0  # no output in it: the last one


@pytest.mark.parametrize(("concentration", "duration"), [(0.3, 1.0), (1.7, 1.0), (9.0, 1.0), (1.7, 3.0), (0.8, 0.5)])
def test_counts_are_whole_and_right_on_average(concentration: float, duration: float) -> None:
    n, unit = 4000, 2.0
    rig = Rig(IdealSensor(count_unit=unit), n)
    counts = rig.smell(concentration, duration).read(duration)
    mean = concentration * duration / unit
    share = mean - math.floor(mean)
    assert set(np.unique(counts)) <= {math.floor(mean), math.floor(mean) + 1.0}
    assert abs(counts.mean() - mean) <= SIGMAS * math.sqrt(share * (1 - share) / n)
    assert np.array_equal(rig.senses["fresh"], counts > 0)


def test_counts_saturate_and_leave_out_what_is_below_the_threshold() -> None:
    rig = Rig(IdealSensor(count_unit=1.0, max_count=4, threshold=0.5), 200)
    assert set(rig.smell(30.0, 1.0).read().ravel()) == {4.0}
    assert not rig.smell(0.5, 1.0).read().any()
    assert rig.smell(0.6, 1.0).read().any()


@pytest.mark.parametrize("mean", [1.0, 6.0])
def test_counts_among_scattered_filaments_are_poisson_to_second_order(mean: float) -> None:
    """Filaments in a cube of side 10 sigma; u = c0 / 2^1.5; the dither may add up to 1/4 to the variance."""
    n, centre, side, rng = 6000, 30.0, 10.0, np.random.default_rng(2)
    unit = centre / 2**1.5
    density = mean * unit / (centre * (2 * math.pi) ** 1.5)  # per sigma^3
    numbers = rng.poisson(density * side**3, n)
    squared = np.sum(rng.uniform(-side / 2, side / 2, (int(numbers.sum()), 3)) ** 2, axis=1)
    world = np.repeat(np.arange(n), numbers)
    field = np.bincount(world, centre * np.exp(-squared / 2), minlength=n).astype(np.float64)[:, None]
    counts = Rig(IdealSensor(count_unit=unit), n).smell(field, 1.0).read()
    assert abs(counts.mean() - mean) < SIGMAS * math.sqrt(mean / n)
    tolerance = SIGMAS * standard_error_of_variance(counts)
    assert mean - tolerance < counts.var() < mean + 0.25 + tolerance


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_world_in_a_batch_is_as_alone_and_worlds_that_are_not_due_stay(sensor: type[ConcentrationSensor]) -> None:
    model = sensor(noise=0.2, drift=0.1, relative_noise=0.1, count_unit=0.5)
    rng = np.random.default_rng(0)
    many, alone, rested = Rig(model, 5, 2), Rig(model, 1, 2, seed=3), Rig(model, 5, 2)
    fields = rng.exponential(2.0, (40, 5, 2))
    sampling = rng.random((40, 5, 2)) < 0.5
    due, all_due, one_due = np.array([False, False, False, True, False]), np.ones(5, np.bool_), np.ones(1, np.bool_)
    for field, counts in zip(fields, sampling, strict=True):
        sniff(many.sniffers, many.response, all_due, all_due, counts, 0.1, field)
        sniff(alone.sniffers, alone.response, one_due, one_due, counts[3:4].copy(), 0.1, field[3:4].copy())
        sniff(rested.sniffers, rested.response, due, all_due, counts, 0.1, field)
    assert many.read()[3].tolist() == alone.read()[0].tolist() == rested.read()[3].tolist()
    assert many.sniffers[3].tobytes() == alone.sniffers[0].tobytes() == rested.sniffers[3].tobytes()
    assert many.sniffers[0, 0]["stream"] != many.sniffers[0, 1]["stream"]
    assert not rested.sniffers["level"][0].any()
    begin_sniffers(many.sniffers, np.array([3]), np.array([3]))
    assert many.sniffers[3].tobytes() == Rig(model, 1, 2, seed=3).sniffers[0].tobytes()


@pytest.mark.parametrize("sensor", SENSORS)
def test_what_a_sensor_says_of_itself(sensor: type[ConcentrationSensor]) -> None:
    model = sensor()
    assert model.measures == "concentration"
    assert model.reports == "concentration"
    assert sensor(count_unit=1.0).reports == "hits"
    assert sensor(count_unit=1.0).scale == 5.0
    assert sensor(typical_reading=12.0).scale == 12.0
    assert model.scale > 0
    assert sensor.model_validate(model.model_dump()) == model
    assert sensor.model_validate_json(model.model_dump_json()) == model


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"threshold": 5.0, "full_scale": 5.0}, "threshold = 5: must be below full_scale = 5"),
        ({"max_count": 3}, "max_count = 3: needs a count_unit"),
        ({"count_unit": 0.0}, "greater than 0"),
        ({"count_unit": 1.0, "max_count": 0}, "greater than or equal to 1"),
        ({"noise": "5 ppm"}, "must be a number"),  # which unit a plume has, no file of units knows
        ({"noise": math.nan}, "must be finite"),
        ({"period": 0.0}, "greater than 0"),
        ({"rise_time": -1.0}, "greater than or equal to 0"),
        ({"gain": 1.0}, "unknown key gain"),
    ],
)
def test_bad_parameters_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        IdealSensor(**changes)
