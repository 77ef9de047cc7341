"""Gas counter and anemometer: means against their laws (tolerance: 5 standard errors), memory of detections."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, hover, random_commands, small, standard_error

from osl_env import World
from osl_env.sensors import count_with_dead_time
from osl_env.streams import Purpose, derive

SIGMAS = 5.0
WORLDS = 3000
SILENT = {"plume.source_strength": 1e-12}


def readings(**changes: Any) -> Any:
    """First readings of `WORLDS` worlds, and the hit rates that they were drawn from, both (WORLDS, 3)."""
    world = begun(small(**changes), list(range(WORLDS)))
    return world.senses["reading"].copy(), world.rates.copy()


@pytest.mark.parametrize(
    ("changes", "miss", "false"),
    [
        ({}, 0.0, 0.0),
        ({"gas_sensor.miss_probability": 0.6}, 0.6, 0.0),
        ({"gas_sensor.false_positive_rate": 0.9}, 0.0, 0.9),
        ({"gas_sensor.miss_probability": 0.3, "gas_sensor.false_positive_rate": 0.2}, 0.3, 0.2),
    ],
)
def test_mean_count_is_missed_hits_less_and_false_counts_more(
    changes: dict[str, float], miss: float, false: float
) -> None:
    hover_time = 1.5
    counts, rates = readings(**changes, **{"vehicle.hover_time": hover_time})
    for uav in range(3):
        expected = (rates[0, uav] * (1 - miss) + false) * hover_time
        assert abs(counts[:, uav].mean() - expected) < SIGMAS * np.sqrt(expected / WORLDS)
        assert abs(counts[:, uav].var() - expected) < SIGMAS * np.sqrt((expected + 2 * expected**2) / WORLDS)  # Poisson


def test_a_longer_sample_counts_for_longer() -> None:
    world = begun(small(action="waypoint"), list(range(WORLDS)))
    world.step_waypoints(world.motion["position"].copy(), np.full((WORLDS, 3), 4))
    expected = 4.0 * world.rates[0]
    assert np.all(np.abs(world.senses["reading"].mean(axis=0) - expected) < SIGMAS * np.sqrt(expected / WORLDS))
    assert np.all(world.senses["sampling_time"] == 4.0)


@pytest.mark.parametrize(("rate", "dead_time"), [(2.0, 0.5), (10.0, 0.1), (0.3, 1.0), (5.0, 2.0)])
def test_dead_time_lowers_the_count_to_that_of_a_non_paralysable_counter(rate: float, dead_time: float) -> None:
    """Renewal theory: rate / (1 + rate * dead_time) counts a second in the long run, give or take one count."""
    duration, n = 500.0, 400
    counts = np.array(
        [count_with_dead_time(np.uint64(derive(k, Purpose.SENSOR, 0)), rate, duration, dead_time)[1] for k in range(n)]
    )
    long_run = duration * rate / (1 + rate * dead_time)
    assert abs(counts.mean() - long_run) < 1.0 + SIGMAS * standard_error(counts)
    assert counts.max() <= duration / dead_time + 1


def test_without_dead_time_the_same_counter_is_poisson() -> None:
    n, rate = 20_000, 1.7
    counts = np.array(
        [count_with_dead_time(np.uint64(derive(k, Purpose.SENSOR, 1)), rate, 1.0, 0.0)[1] for k in range(n)]
    )
    assert abs(counts.mean() - rate) < SIGMAS * np.sqrt(rate / n)
    assert abs(counts.var() - rate) < SIGMAS * np.sqrt((rate + 2 * rate**2) / n)


def test_dead_time_reaches_the_worlds_sensor() -> None:
    free, _ = readings(**{"gas_sensor.false_positive_rate": 8.0} | SILENT)
    blind, _ = readings(**{"gas_sensor.false_positive_rate": 8.0, "gas_sensor.dead_time": 0.4} | SILENT)
    assert free.max() > 3
    assert blind.max() <= 3  # 1 s holds three counts that are 0.4 s apart
    assert blind.mean() < 0.5 * free.mean()


def test_no_hits_without_a_source() -> None:
    counts, _ = readings(**SILENT)
    assert not counts.any()


def test_anemometer_noise_is_horizontal_gaussian_and_fresh_each_time() -> None:
    world = begun(small(**{"anemometer.noise": 0.4, "wind.velocity": (0.5, -1.0, 0.0)}), list(range(WORLDS)))
    first = world.senses["wind"].copy().reshape(-1, 3)
    n = len(first)
    assert not first[:, 2].any()
    for axis, mean in ((0, 0.5), (1, -1.0)):
        assert abs(first[:, axis].mean() - mean) < SIGMAS * 0.4 / np.sqrt(n)
        assert abs(first[:, axis].std() - 0.4) < SIGMAS * 0.4 / np.sqrt(2 * n)
    assert abs(np.corrcoef(first[:, 0], first[:, 1])[0, 1]) < SIGMAS / np.sqrt(n)
    world.step_hops(hover(world))
    second = world.senses["wind"].reshape(-1, 3)
    assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < SIGMAS / np.sqrt(n)


def test_the_ideal_anemometer_reads_the_wind() -> None:
    world = begun(small(**{"wind.random_direction": True}), list(range(50)))
    assert np.array_equal(world.senses["wind"], np.broadcast_to(world.episode["wind"][:, None], (50, 3, 3)))


def test_noise_of_one_sensor_does_not_change_the_other() -> None:
    quiet, noisy = begun(small(), [5, 6]), begun(small(**{"anemometer.noise": 1.0}), [5, 6])
    rng = np.random.default_rng(0)
    for _ in range(10):
        commands = random_commands(quiet, rng)
        advance(quiet, commands)
        advance(noisy, commands)
        assert quiet.senses["reading"].tolist() == noisy.senses["reading"].tolist()


def sequence(samples_of_uav_0: int) -> tuple[list[Any], list[Any]]:
    """Readings and measured winds of UAVs 1 and 2 while UAV 0 takes `samples_of_uav_0` samples a leg."""
    noise = {"anemometer.noise": 0.3, "gas_sensor.false_positive_rate": 0.5, "ending.time_limit": 1000.0}
    world: World = begun(small(action="waypoint", **noise), [3])
    rng, samples = np.random.default_rng(1), np.array([[samples_of_uav_0, 1, 2]])
    gas, wind = [], []
    for _ in range(12):
        targets, _ = random_commands(world, rng)
        world.step_waypoints(targets, samples)
        gas.append(world.senses["reading"][0, 1:].tolist())
        wind.append(world.senses["wind"][0, 1:].tolist())
    return gas, wind


def test_extra_samples_of_one_uav_do_not_change_what_the_others_sense() -> None:
    assert sequence(1) == sequence(7)


def test_the_last_three_detections_are_remembered_latest_first() -> None:
    world = begun(small(), [11])
    rng = np.random.default_rng(4)
    seen: list[list[tuple[float, list[float], float]]] = [[], [], []]
    for step in range(15):
        if step:
            advance(world, random_commands(world, rng))
        for uav in range(3):
            senses = world.senses[0, uav]
            if senses["reading"] > 0:
                clock = float(world.episode["clock"][0])
                seen[uav].insert(0, (clock, world.motion["position"][0, uav].tolist(), float(senses["reading"])))
            observation = world.observation(0, uav)
            remembered = seen[uav][:3]
            assert int(senses["detections"]) == len(seen[uav])
            assert observation.detection_mask.tolist() == [k < len(remembered) for k in range(3)]
            for k, (time, place, reading) in enumerate(remembered):
                assert observation.detection_age[k] == pytest.approx(observation.time - time, abs=1e-9)
                np.testing.assert_allclose(observation.detection_position[k], place, atol=1e-9)
                assert observation.detection_reading[k] == reading
    assert max(map(len, seen)) > 3
