"""UavVecEnv: step by step what a loop of single worlds gives; SB3's contract; learning."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from worlds import NOISY, flying, small

import osl_env
from osl_env import Scenario
from osl_env.errors import InputError
from osl_env.streams import following_seeds, next_episode_seed

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecMonitor

from baselines.features import RawFeatures, SoloFeatures, make_spec
from training.sb3_vec_env import UavVecEnv
from training.vec_group import SharedInfo

torch.set_num_threads(1)  # the networks here are too small to share
RAW = make_spec([RawFeatures(neighbours=2)])  # of three UAVs: exactly the flat observation
TIME_LIMIT = "ending.time_limit"


class Loop:
    """The same worlds one by one through the PettingZoo view, begun anew by hand."""

    def __init__(self, scenario: Scenario, seeds: list[int]) -> None:
        self.envs = [osl_env.parallel_env(scenario) for _ in seeds]
        self.seeds = seeds
        self.rows = np.concatenate([self.begin(k) for k in range(len(seeds))])

    def begin(self, k: int) -> Any:
        observations, _ = self.envs[k].reset(seed=self.seeds[k])
        return np.stack(list(observations.values()))

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[int, tuple[Any, bool]]]:
        """Observations, rewards and dones of all slots, and last observation and truncation of those that ended."""
        n = len(self.envs[0].possible_agents)
        rows, ends = np.zeros_like(self.rows), {}
        rewards, dones = np.zeros(len(rows), np.float32), np.zeros(len(rows), bool)
        for k, env in enumerate(self.envs):
            before = list(env.agents)
            slots = {agent: n * k + i for i, agent in enumerate(env.possible_agents)}
            seen, paid, terminated, truncated, _ = env.step({agent: actions[slots[agent]] for agent in before})
            for agent in before:
                slot = slots[agent]
                rewards[slot] = paid[agent]
                if agent in env.agents:
                    rows[slot] = seen[agent]
                else:
                    dones[slot] = True
                    ends[slot] = (seen[agent], truncated[agent] and not terminated[agent])
            if not env.agents:
                for slot in slots.values():
                    ends.setdefault(slot, (np.zeros(rows.shape[1]), False))  # idle until now
                    dones[slot] = True
                self.seeds[k] = next_episode_seed(self.seeds[k])
                rows[n * k : n * (k + 1)] = self.begin(k)
        return rows, rewards, dones, ends


SCENARIOS = {
    "hops": small(),
    "short time": small(**{TIME_LIMIT: 15.0}),
    "batteries end one by one": small(**{"energy.capacity": 1200.0, TIME_LIMIT: 1e4}),
    "few decisions": small(**{"ending.max_decisions": 4}),
    "noisy waypoints": small(**NOISY, action="waypoint"),
    "events": small(clock="event", action="waypoint", **{TIME_LIMIT: 25.0}),
    "velocities": flying(**{TIME_LIMIT: 12.0}),
    "reaching": small(**{"ending.success": "reach"}),
    "shaped": small(**{"reward.shaping": 0.1, "reward.detection": 0.5}),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_slot_is_what_a_loop_of_single_worlds_gives(name: str) -> None:
    scenario = SCENARIOS[name]
    env = UavVecEnv(scenario, 4, RAW)
    env.seed(70)
    rows = env.reset()
    seeds = [70 + 3 * k for k in range(4)]  # SB3 gives slot i seed + i; a world takes its first slot's
    loop = Loop(scenario, seeds)
    np.testing.assert_array_equal(rows, loop.rows)
    rng, ended, idle = np.random.default_rng(3), 0, 0
    for _ in range(80):
        actions = np.stack([env.action_space.sample() for _ in range(env.num_envs)])
        if scenario.action == "hop":
            actions = rng.integers(0, env.action_space.n - (rng.random() < 0.9), env.num_envs)
        resting = env.idle
        rows, rewards, dones, infos = env.step(actions)
        expected, paid, over, ends = loop.step(actions)
        np.testing.assert_array_equal(rows, expected)
        np.testing.assert_array_equal(rewards, paid)
        np.testing.assert_array_equal(dones, over)
        for slot, info in enumerate(infos):
            assert ("terminal_observation" in info) == (slot in ends)
            if slot in ends:
                np.testing.assert_array_equal(info["terminal_observation"], ends[slot][0])
                assert info["TimeLimit.truncated"] == ends[slot][1]
            assert info.get("idle", False) == resting[slot]
            assert ("episode" in info) == (slot in ends and not resting[slot])
        ended += len(ends)
        idle += int(resting.sum())
    assert ended > 0
    assert (idle > 0) == (
        name in ("batteries end one by one", "short time", "events", "hops", "noisy waypoints")
    ) or idle


def test_groups_stand_side_by_side_and_do_not_touch_each_other() -> None:
    scenarios = [small(), small(**{"team.n_uavs": 5}), small(**{"team.n_uavs": 1, "wind.velocity": (1.0, 0.0, 0.0)})]
    spec = make_spec([{"kind": "raw", "neighbours": 4}, {"kind": "belief", "particles": 16}])
    together = UavVecEnv(scenarios, 6, spec)
    assert together.num_envs == 2 * (3 + 5 + 1)
    apart = [UavVecEnv(scenario, 2, spec) for scenario in scenarios]
    together.seed(5)
    rows, start = together.reset(), 0
    bounds = []
    for env in apart:
        env.seed(5 + start)
        bounds.append(slice(start, start + env.num_envs))
        np.testing.assert_array_equal(env.reset(), rows[bounds[-1]])
        start += env.num_envs
    rng = np.random.default_rng(0)
    for _ in range(30):
        actions = rng.integers(0, together.action_space.n, together.num_envs)
        rows, rewards, dones, infos = together.step(actions)
        for env, part in zip(apart, bounds, strict=True):
            alone = env.step(actions[part])
            np.testing.assert_array_equal(rows[part], alone[0])
            np.testing.assert_array_equal(rewards[part], alone[1])
            np.testing.assert_array_equal(dones[part], alone[2])
            assert [sorted(info) for info in infos[part]] == [sorted(info) for info in alone[3]]


def test_features_with_memory_begin_anew_with_their_world() -> None:
    """Through several episodes of a world, against what a UAV alone would observe."""
    scenario = small(**{TIME_LIMIT: 12.0})
    spec = make_spec([{"kind": "hits", "length": 4, "heard": True}, {"kind": "belief", "particles": 16}])
    env = UavVecEnv(scenario, 2, spec)
    rows, world = env.reset(), env.groups[0].world
    from baselines import Briefing

    def fresh(k: int) -> list[SoloFeatures]:
        seed, places = int(world.episode["seed"][k]), world.motion["position"][k]
        return [SoloFeatures(spec, Briefing.of(scenario, i, seed, places[i])) for i in range(3)]

    pilots, episodes = [fresh(0), fresh(1)], 0
    rng = np.random.default_rng(1)
    for _ in range(25):
        inboxes = world.exchange([[None] * 3] * 2)
        for k in range(2):
            for i in np.flatnonzero(world.motion["active"][k]):
                row = pilots[k][i].update(world.observation(k, int(i)), inboxes[k][i])
                np.testing.assert_array_equal(row, rows[3 * k + i])
        seeds = world.episode["seed"].copy()
        rows = env.step(rng.integers(0, env.action_space.n - 1, 6))[0]
        for k in np.flatnonzero(world.episode["seed"] != seeds):
            pilots[k], episodes = fresh(int(k)), episodes + 1
    assert episodes > 2


def test_a_declaration_is_no_truncation_and_is_told() -> None:
    env = UavVecEnv(small(), 2, RAW)
    env.reset()
    source = env.groups[0].world.source_position[0, 0]
    actions = np.full(6, 52)  # hover
    env.step(actions)
    env.groups[0].world.motion["position"][0, 1] = source
    actions[1] = 53  # declares where the source is
    _, rewards, dones, infos = env.step(actions)
    assert dones.tolist() == [True] * 3 + [False] * 3
    assert (rewards[:3] > 15).all()
    assert all(info["is_success"] and not info["TimeLimit.truncated"] for info in infos[:3])
    assert infos[0]["episode"]["l"] == 2
    assert infos[0]["episode"]["r"] == pytest.approx(rewards[0] - 1.0 / 60.0, abs=1e-6)


def test_seeds_follow_each_other_and_resume() -> None:
    env = UavVecEnv(small(), 3, RAW, seed=2**40)
    env.reset()
    first = following_seeds(2**40 + np.arange(3))
    assert env.get_attr("episode_seed") == np.repeat(first, 3).tolist()
    rng = np.random.default_rng(0)
    for _ in range(60):
        env.step(rng.integers(0, env.action_space.n, env.num_envs))
    state = env.state_dict()
    again = UavVecEnv(small(), 3, RAW)
    again.load_state_dict(state)
    again.reset()
    assert again.state_dict() == state
    assert state["seeds"][0] != first.tolist()
    with pytest.raises(InputError, match="other worlds"):
        UavVecEnv(small(), 2, RAW).load_state_dict(state)


def test_attributes_methods_and_wrappers() -> None:
    env = UavVecEnv(small(), 2, RAW)
    env.reset()
    assert env.get_attr("render_mode") == [None] * 6
    assert env.has_attr("scenario")
    assert not env.has_attr("nothing_like_it")
    env.set_attr("label", 7, indices=[1, 3])
    assert env.get_attr("label", indices=3) == [7]
    masks = env.env_method("action_masks")
    np.testing.assert_array_equal(np.stack(masks), env.groups[0]._translator.masks().reshape(6, -1))
    np.testing.assert_array_equal(env.env_method("action_masks", indices=[4])[0], masks[4])
    assert env.env_is_wrapped(Monitor) == [True] * 6
    assert env.env_is_wrapped(gym.Wrapper, indices=[0]) == [False]
    with pytest.warns(UserWarning, match="already wrapped"):
        monitored = VecMonitor(env)
    monitored.reset()
    assert "mine" not in monitored.step(np.full(6, 52))[3][0]
    env.close()
    env.close()


def test_infos_without_news_are_shared_and_refuse_to_be_written() -> None:
    env = UavVecEnv(small(), 2, RAW)
    env.reset()
    infos = env.step(np.full(6, 52))[3]
    assert infos[0] is infos[5]
    assert isinstance(infos[0], SharedInfo)
    with pytest.raises(TypeError, match="shared"):
        infos[0]["mine"] = 1
    with pytest.raises(TypeError, match="shared"):
        infos[0].update(mine=1)
    assert type(copy.deepcopy(infos)[0]) is dict
    copied = infos[0].copy()
    copied["mine"] = 1
    assert "mine" not in infos[1]


def test_returned_arrays_are_fresh() -> None:
    env = UavVecEnv(small(), 2, RAW)
    before = env.reset()
    kept = before.copy()
    first = env.step(np.zeros(6, np.int64))
    np.testing.assert_array_equal(before, kept)
    first[1][:] = 99.0
    assert not (env.step(np.zeros(6, np.int64))[1] == 99.0).any()


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: UavVecEnv(small(), 0, RAW), "n_worlds"),
        (lambda: UavVecEnv([small(), small()], 1, RAW), "n_worlds"),
        (lambda: UavVecEnv([], 1, RAW), "at least one"),
        (lambda: UavVecEnv([small(), small(**{"vehicle.hop_lengths": 3})], 2, RAW), "action spaces"),
        (lambda: UavVecEnv("rate-60x60", 2, RAW), "did you mean"),
        (lambda: UavVecEnv(small(), 2, RAW, seed=-1), "seed"),
        (lambda: UavVecEnv(small(), 2, RAW).step(np.zeros(6, np.int64)), "reset"),
        (lambda: UavVecEnv(small(), 2, RAW).step(np.zeros(5, np.int64)), "shape"),
    ],
)
def test_bad_input_is_one_line(make: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as refusal:
        make()
    assert "\n" not in str(refusal.value)


def test_sb3_learns_with_ppo() -> None:
    """Hovering costs least where declaring falsely is dear: PPO finds that within a few rollouts."""
    env = UavVecEnv(small(**{TIME_LIMIT: 20.0}), 32, RAW)
    model = PPO("MlpPolicy", env, n_steps=16, batch_size=512, n_epochs=4, learning_rate=1e-2, seed=1,
                device="cpu", policy_kwargs={"net_arch": [16]})  # fmt: skip
    model.learn(env.num_envs * 16)
    before = np.mean([entry["r"] for entry in model.ep_info_buffer])
    model.learn(env.num_envs * 16 * 6)
    assert np.mean([entry["r"] for entry in model.ep_info_buffer]) > before + 2.0
    assert len(model.ep_success_buffer) > 0
    mean, _ = evaluate_policy(model, env, n_eval_episodes=8, warn=True)
    assert np.isfinite(mean)


def test_sb3_learns_off_policy() -> None:
    dqn = DQN("MlpPolicy", UavVecEnv(small(**{TIME_LIMIT: 8.0}), 4, RAW), learning_starts=24, batch_size=16, seed=0,
              buffer_size=1200, device="cpu")  # fmt: skip
    dqn.learn(12 * 20)
    sac = SAC("MlpPolicy", UavVecEnv(flying(), 2, RAW), learning_starts=12, batch_size=16, seed=0,
              buffer_size=600, device="cpu")  # fmt: skip
    sac.learn(6 * 10)
    assert dqn.num_timesteps == 240
    assert sac.num_timesteps == 60


@pytest.mark.parametrize(
    ("identity", "action"), [("Solo", "hop"), ("Solo", "waypoint"), ("Team", "hop"), ("Team", "waypoint")]
)
def test_sb3_trains_on_what_gym_makes(identity: str, action: str) -> None:
    env = gym.make(f"osl_env/{identity}-v0", scenario=small(), action=action)
    model = PPO("MlpPolicy", env, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    model.learn(64)
    action_taken, _ = model.predict(env.reset(seed=1)[0], deterministic=True)
    assert env.action_space.contains(action_taken) or env.action_space.shape == ()
