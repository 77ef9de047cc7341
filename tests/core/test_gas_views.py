"""Worlds with gas, moving air, obstacles and range sensors, seen through the standard interfaces."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from worlds import advance, begun, random_commands

import osl_env
from osl_env import Scenario, load_scenario
from osl_env.geometry import range_readings
from osl_env.streams import next_episode_seed

PRESETS = ("gaden-60x60x30", "puff-source1", "tunnel-a", "arena-4x6-5", "arena-30x40")
EACH_SEES = {"count": 8, "range": 2.0, "noise": 0.05}


def short(name: str, **changes: Any) -> Scenario:
    """A preset with three UAVs (or its own number, if less), soon over, after a short development."""
    plain = load_scenario(name)
    settings: dict[str, Any] = {"team.n_uavs": min(3, plain.team.n_uavs), "ending.max_decisions": 12}
    if "development" in type(plain.plume).model_fields:
        settings["plume.development"] = 2.0
    return load_scenario(plain, **(settings | changes))


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("observation", ["flat", "physical"])
def test_pettingzoo(name: str, observation: str) -> None:
    parallel_api_test(osl_env.parallel_env(short(name), observation=observation), num_cycles=30)
    parallel_seed_test(lambda: osl_env.parallel_env(short(name), observation=observation), num_cycles=8)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("view", ["Solo", "Team"])
def test_gymnasium_and_stable_baselines3(name: str, view: str) -> None:
    env = gym.make(f"osl_env/{view}-v0", scenario=short(name), render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*flattened array.*|.*not within the observation space.*")
        check_env(env.unwrapped)
        warnings.simplefilter("ignore")
        try:
            from stable_baselines3.common.env_checker import check_env as check_for_sb3
        except ImportError:
            return
        check_for_sb3(env)
    env.close()


@pytest.mark.parametrize("name", PRESETS)
def test_a_vector_env_begins_its_worlds_anew_as_single_ones(name: str) -> None:
    """Whole episodes, whose worlds end at different times: each slot is a batch of one."""
    scenario = short(name, **{"energy.capacity": 3e3 if name.startswith("gaden") else 60.0})
    vector, rng = osl_env.make_vec(scenario, 3), np.random.default_rng(0)
    seen, _ = vector.reset(seed=[5, 6, 7])
    singles = [gym.make("osl_env/Team-v0", scenario=scenario) for _ in range(3)]
    seeds = [5, 6, 7]
    for k, env in enumerate(singles):
        np.testing.assert_array_equal(env.reset(seed=seeds[k])[0], seen[k])
    over, ended = np.zeros(3, np.bool_), 0
    for _ in range(30):
        vector.action_space.seed(int(rng.integers(1000)))
        actions = vector.action_space.sample()
        if scenario.action == "hop":
            actions = np.minimum(actions, 26 * scenario.vehicle.hop_lengths)  # nobody declares
        seen, _, terminated, truncated, _ = vector.step(actions)
        for k, env in enumerate(singles):
            if over[k]:
                seeds[k] = next_episode_seed(seeds[k])
                alone = env.reset(seed=seeds[k])[0]
            else:
                alone = env.step(actions[k])[0]
            np.testing.assert_array_equal(alone, seen[k])
        over = terminated | truncated
        ended += int(over.sum())
    assert ended > 1


@pytest.mark.parametrize("name", [*PRESETS, "random"])
def test_range_sensors_and_readings_are_in_both_forms_of_an_observation(name: str) -> None:
    walls = {"arena.bounds": "hold"}  # else there may be nothing to see
    scenario = short("arena-4x6-10-random" if name == "random" else name, range_sensors=EACH_SEES, **walls)
    world, rng = begun(scenario, [1, 2]), np.random.default_rng(0)
    layout, n = world.layout, scenario.range_sensors.count
    seen = np.empty_like(world.ranges)
    near = 0
    for _ in range(8):
        flat = layout.flat(world)
        assert np.abs(flat).max() <= 1.0
        geometry, area = scenario.arena.geometry, np.array(scenario.arena.size)
        range_readings(geometry, area, world.motion["position"], n, scenario.range_sensors.range, seen)
        for env in range(2):
            for uav in range(world.n_uavs):
                ranges = world.observation(env, uav).ranges
                assert ranges.tolist() == world.ranges[env, uav].tolist()
                np.testing.assert_allclose(flat[env, uav, -n:], ranges / 2.0, atol=1e-6)
                assert np.abs(ranges - seen[env, uav]).max() < 6 * 0.05
                near += int((ranges < 2.0).sum())
                reading, scale = world.observation(env, uav).reading, scenario.gas_sensor.scale
                assert flat[env, uav, 13] == pytest.approx(reading / (reading + scale), abs=1e-6)
        advance(world, random_commands(world, rng))
    assert near > 0 or name in ("puff-source1", "gaden-60x60x30", "arena-30x40")


def test_the_noise_of_range_sensors_in_a_row_does_not_depend_on_the_others() -> None:
    scenario = short("arena-4x6-5", range_sensors=EACH_SEES)
    batch, alone = begun(scenario, [4, 9]), begun(scenario, 9)
    for step in range(6):
        batch.step_velocities(np.full((2, 3, 3), 0.1))
        alone.step_velocities(np.full((1, 3, 3), 0.1))
        if step == 2:
            kept = batch.ranges[1].copy()
            batch.reset(np.array([8, 0]), np.array([True, False]))
            assert batch.ranges[1].tolist() == kept.tolist()
        assert batch.ranges[1].tolist() == alone.ranges[0].tolist()
    assert (batch.ranges[1] < 2.0).any()


def test_a_uav_in_flight_looks_only_where_it_arrives() -> None:
    """Event clock: what a UAV saw when it decided holds until it decides again, whatever the others do."""
    scenario = short("arena-4x6-5", range_sensors=EACH_SEES, action="waypoint", clock="event")
    world, rng = begun(scenario, 4), np.random.default_rng(1)
    flew_on = 0
    for _ in range(12):
        kept, place = world.ranges[0].copy(), world.motion["position"][0].copy()
        targets = place + rng.uniform(-0.2, 0.2, (3, 3)) * [[0.1], [0.5], [1.0]]
        world.step_waypoints(targets[None], np.ones((1, 3), np.int64))
        for uav in range(3):
            same = world.ranges[0, uav].tolist() == kept[uav].tolist()
            assert same == (not world.motion["ready"][0, uav])
            flew_on += same
    assert flew_on > 0
