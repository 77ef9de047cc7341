"""UavVecEnv in worlds with gas, obstacles and range sensors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import osl_env
from baselines.features import RawFeatures, make_spec
from osl_env import load_scenario
from osl_env.streams import next_episode_seed
from training.sb3_vec_env import UavVecEnv


@pytest.mark.parametrize("name", ["gaden-60x60x30", "arena-4x6-5"])
def test_every_slot_is_what_a_loop_of_single_worlds_gives(name: str) -> None:
    changes = {"team.n_uavs": 3, "plume.development": 2.0, "ending.max_decisions": 7}
    scenario = load_scenario(name, **changes)
    spec = make_spec([RawFeatures(neighbours=2)])
    env = UavVecEnv(scenario, 2, spec)
    env.seed(70)
    rows: Any = env.reset()
    seeds = [70, 73]  # SB3 gives slot i seed + i; a world takes its first slot's
    loop = [osl_env.parallel_env(scenario) for _ in seeds]
    alone = [single.reset(seed=seed)[0] for single, seed in zip(loop, seeds, strict=True)]
    width, ended = rows.shape[1], 0
    assert env.num_envs == 6
    for _ in range(20):
        expected = np.concatenate([list(seen.values()) for seen in alone])
        assert expected.shape[1] == width + scenario.range_sensors.count
        np.testing.assert_array_equal(rows, expected[:, :width])
        actions = np.stack([env.action_space.sample() for _ in range(6)])
        if scenario.action == "hop":
            actions = np.minimum(actions, 26 * scenario.vehicle.hop_lengths)
        rows, _, dones, _ = env.step(actions)
        for k, single in enumerate(loop):
            agents = single.possible_agents
            alone[k] = single.step({agent: actions[3 * k + i] for i, agent in enumerate(agents)})[0]
            assert bool(single.agents) != dones[3 * k]
            if not single.agents:
                seeds[k] = next_episode_seed(seeds[k])
                alone[k], ended = single.reset(seed=seeds[k])[0], ended + 1
    assert ended >= 4
