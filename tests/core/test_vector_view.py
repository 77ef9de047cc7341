"""The vector view: sub-environment i is the single environment, whatever the autoreset mode."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from worlds import NOISY, small

import osl_env
from osl_env import InputError, Scenario
from osl_env.envs.single import TeamEnv
from osl_env.envs.vector import TeamVectorEnv

N = 5
MODES: dict[str, dict[str, Any]] = {
    "hop": {},
    "noisy": NOISY,
    "waypoint": {"action": "waypoint"},
    "velocity": {"vehicle": {"kind": "point_mass"}, "action": "velocity"},
    "setpoint": {"vehicle": {"kind": "point_mass"}, "action": "setpoint"},
    "event": {"clock": "event"},
    "battery": {"energy.capacity": 7000.0},
}


def scenario(mode: str) -> Scenario:
    """Short episodes of different lengths, so that rows end at different times."""
    return small(**{"ending.time_limit": 14.0, "ending.success": "reach", "ending.success_radius": 4.0} | MODES[mode])


def actions(env: TeamVectorEnv, steps: int) -> list[Any]:
    env.action_space.seed(0)
    return [env.action_space.sample() for _ in range(steps)]


@pytest.mark.parametrize("mode", MODES)
def test_next_step_is_the_single_environment_reset_at_the_next_step(mode: str) -> None:
    vector, singles = osl_env.make_vec(scenario(mode), N), [TeamEnv(scenario(mode)) for _ in range(N)]
    assert vector.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, infos = vector.reset(seed=10)
    firsts = [single.reset(seed=10 + i) for i, single in enumerate(singles)]
    compare(seen, infos, firsts)
    ended, ends = [False] * N, 0
    for step in actions(vector, 40):
        seen, rewards, terminated, truncated, infos = vector.step(step)
        for i, single in enumerate(singles):
            if ended[i]:
                expected: Any = (*single.reset(), 0.0, False, False)
            else:
                o, r, t, c, info = single.step(step[i])
                expected = (o, info, r, t, c)
            assert np.array_equal(seen[i], expected[0])
            assert {key: infos[key][i] for key in expected[1]} == expected[1]
            assert (rewards[i], terminated[i], truncated[i]) == expected[2:]
            ended[i] = expected[3] or expected[4]
            ends += ended[i]
    assert ends >= 2 * N
    assert rewards.dtype == np.float64


def compare(seen: Any, infos: dict[str, Any], firsts: list[Any]) -> None:
    for i, (observation, info) in enumerate(firsts):
        assert np.array_equal(seen[i], observation)
        assert {key: infos[key][i] for key in info} == info


@pytest.mark.parametrize("mode", MODES)
def test_same_step_shows_the_next_episode_and_keeps_the_last_observation(mode: str) -> None:
    vector = osl_env.make_vec(scenario(mode), N, autoreset_mode=AutoresetMode.SAME_STEP)
    singles = [TeamEnv(scenario(mode)) for _ in range(N)]
    seen, infos = vector.reset(seed=10)
    compare(seen, infos, [single.reset(seed=10 + i) for i, single in enumerate(singles)])
    ends = 0
    for step in actions(vector, 40):
        seen, rewards, terminated, truncated, infos = vector.step(step)
        results = [single.step(step[i]) for i, single in enumerate(singles)]
        ended = [r[2] or r[3] for r in results]
        assert ("final_obs" in infos) == any(ended)
        for i, (observation, reward, t, c, info) in enumerate(results):
            assert (rewards[i], terminated[i], truncated[i]) == (reward, t, c)
            if not ended[i]:
                assert np.array_equal(seen[i], observation)
                continue
            ends += 1
            assert infos["_final_obs"][i]
            assert infos["_final_info"][i]
            assert np.array_equal(infos["final_obs"][i], observation)
            assert {key: infos["final_info"][key][i] for key in info} == info
            first, info = singles[i].reset()
            assert np.array_equal(seen[i], first)
            assert {key: infos[key][i] for key in info} == info
        if any(ended):
            assert infos["_final_obs"].tolist() == ended
    assert ends >= 2 * N


@pytest.mark.parametrize("mode", MODES)
def test_disabled_leaves_ended_worlds_until_their_masked_reset(mode: str) -> None:
    vector = osl_env.make_vec(scenario(mode), N, autoreset_mode="Disabled")
    singles = [TeamEnv(scenario(mode)) for _ in range(N)]
    vector.reset(seed=list(range(20, 20 + N)))
    for i, single in enumerate(singles):
        single.reset(seed=20 + i)
    resets = 0
    for number, step in enumerate(actions(vector, 30)):
        seen, rewards, terminated, truncated, _ = vector.step(step)
        results = [single.step(step[i]) for i, single in enumerate(singles)]
        ended = np.array([r[2] or r[3] for r in results])
        for i, (observation, reward, t, c, _) in enumerate(results):
            assert np.array_equal(seen[i], observation)
            assert (rewards[i], terminated[i], truncated[i]) == (reward, t, c)
        if ended.any():
            resets += 1
            seeds = [1000 * number + i if i % 2 else None for i in range(N)]
            seen, _ = vector.reset(seed=seeds, options={"reset_mask": ended})
            for i in np.flatnonzero(ended):
                assert np.array_equal(seen[i], singles[i].reset(seed=seeds[i])[0])
            for i in np.flatnonzero(~ended):
                assert np.array_equal(seen[i], results[i][0])
    assert resets >= 2


def test_an_ended_world_stays_ended_when_it_is_not_reset() -> None:
    vector = osl_env.make_vec(small(**{"ending.max_decisions": 2}), 2, autoreset_mode=AutoresetMode.DISABLED)
    vector.reset(seed=1)
    for step in range(5):
        _, rewards, terminated, truncated, _ = vector.step(np.full((2, 3), 52))
        assert truncated.tolist() == [step >= 1] * 2
        assert not terminated.any()
        assert bool(rewards.any()) == (step < 2)


def test_observations_rewards_and_infos_are_fresh_arrays() -> None:
    vector = osl_env.make_vec(small(), 2)
    first, infos = vector.reset(seed=1)
    results = [vector.step(np.full((2, 3), k)) for k in (1, 52)]
    assert not np.shares_memory(results[0][0], results[1][0])
    assert not np.shares_memory(first, results[0][0])
    for k in (1, 2, 3):
        assert not np.shares_memory(results[0][k], results[1][k])
    assert infos["clock"].tolist() == [1.0, 1.0]


def test_rewards_of_each_uav_are_at_hand() -> None:
    vector = osl_env.make_vec(small(), 4)
    vector.reset(seed=1)
    _, rewards, *_ = vector.step(actions(vector, 1)[0])
    np.testing.assert_allclose(vector.uav_rewards.mean(axis=1), rewards, rtol=1e-12)


def test_an_integer_seed_counts_up_and_a_list_is_taken_as_it_is() -> None:
    vector = osl_env.make_vec(small(), 4)
    vector.reset(seed=7)
    assert vector.world.episode["seed"].tolist() == [7, 8, 9, 10]
    vector.reset(seed=[3, 1, 4, 1])
    assert vector.world.episode["seed"].tolist() == [3, 1, 4, 1]


def test_unseeded_worlds_differ() -> None:
    first, second = osl_env.make_vec(small(), 3), osl_env.make_vec(small(), 3)
    first.reset()
    second.reset()
    assert len({*first.world.episode["seed"].tolist(), *second.world.episode["seed"].tolist()}) == 6


@pytest.mark.parametrize("name", ["osl_env/Solo-v0", "osl_env/Team-v0"])
@pytest.mark.parametrize("vectorization", [None, "sync"])
def test_gym_make_vec(name: str, vectorization: str | None) -> None:
    vector: Any = gym.make_vec(name, num_envs=3, vectorization_mode=vectorization, scenario=small())
    assert isinstance(vector.unwrapped, TeamVectorEnv) == (vectorization is None)
    single = gym.make(name, scenario=small())
    seen, _ = vector.reset(seed=4)
    assert np.array_equal(seen[1], single.reset(seed=5)[0])
    assert vector.single_action_space == single.action_space
    assert vector.single_observation_space == single.observation_space
    vector.action_space.seed(1)
    for _ in range(5):
        step = vector.action_space.sample()
        assert np.array_equal(vector.step(step)[0][1], single.step(step[1])[0])
    vector.close()


def test_max_episode_steps_truncates_in_make_vec() -> None:
    vector: Any = gym.make_vec("osl_env/Team-v0", num_envs=2, scenario=small(), max_episode_steps=3)
    vector.reset(seed=1)
    flags = [vector.step(np.full((2, 3), 52))[3].tolist() for _ in range(3)]
    assert flags == [[False, False], [False, False], [True, True]]


@pytest.mark.parametrize(
    "arguments",
    [{"render_mode": "rgb_array"}, {"autoreset_mode": "sometimes"}, {"max_episode_steps": 0}, {"nothing": 1}],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        osl_env.make_vec(small(), 2, **arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "arguments",
    [
        {"seed": [1]},
        {"seed": [1, -2]},
        {"seed": 2**63 - 1},
        {"options": {"reset_mask": np.array([True])}},
        {"options": {"reset_mask": np.array([1, 0])}},
        {"options": {"reset_mask": np.array([False, False])}},
    ],
)
def test_bad_resets_are_refused(arguments: dict[str, Any]) -> None:
    vector = osl_env.make_vec(small(), 2)
    with pytest.raises(InputError) as caught:
        vector.reset(**arguments)
    assert "\n" not in str(caught.value)
