"""The agent `search` in training: the VecEnv of levers, against the flown policy, and through `train`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from baselines import make_policy
from baselines.search_agent.crew import SearchView
from baselines.search_agent.levers import MACRO_BEATS, N_LEVERS, N_SITUATION
from osl_env.errors import InputError
from osl_env.scenario_files import load_scenario
from osl_env.streams import following_seeds
from tests.checkpoints import search_checkpoint
from training.flight import run_batch

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO

from training.search_environment import SearchEnvironment
from training.search_vec_env import SearchGroup, SearchVecEnv

SCENARIO = load_scenario("rate-60x60x30-random")


def test_the_flown_policy_does_what_the_environment_was_trained_in(tmp_path: Path) -> None:
    """With all levers at 0.3 through the network's bias: the same outcomes, and the same mission times."""
    from baselines.learned.checkpoint import Checkpoint

    loaded = Checkpoint.load(search_checkpoint(tmp_path / "agent"))
    arrays = {name: np.zeros_like(array) for name, array in loaded.arrays.items()}
    arrays["action.bias"][:] = 0.3
    Checkpoint(loaded.header, arrays).write(tmp_path / "constant")
    seeds = [0, 1, 2, 3, 4]
    records = run_batch(make_policy("checkpoint", path=tmp_path / "constant"), SCENARIO, seeds)
    group = SearchGroup(SCENARIO, len(seeds), SearchView(), 0.98)
    group.seeds[:] = seeds
    group.reset(np.ones(len(seeds), np.bool_))
    group.crew.set_levers(np.full((len(seeds), N_LEVERS), 0.3))
    ends: dict[int, tuple[float, bool]] = {}
    while len(ends) < len(seeds):
        _, done = group.beat()
        for k, env in enumerate(np.flatnonzero(done).tolist()):
            ends.setdefault(env, (float(group.times[k]), bool(group.successes[k])))
    for env, record in enumerate(records):
        assert ends[env] == (pytest.approx(min(record.mission_time, 1200.0)), record.success)


def test_groups_do_not_disturb_each_other_and_seeds_repeat() -> None:
    five = SCENARIO.override(**{"team.n_uavs": 5})
    rng = np.random.default_rng(2)
    actions = rng.uniform(-1.0, 1.0, (6, 5, N_LEVERS))
    both, alone = SearchVecEnv([(SCENARIO, 3), (five, 2)], seed=9), SearchVecEnv([(SCENARIO, 3)], seed=9)
    assert both.num_envs == 5
    assert both.observation_space.shape == (N_SITUATION,)
    first = both.reset()
    np.testing.assert_array_equal(first[:3], alone.reset())
    for levers in actions:
        seen, rewards, done, _ = both.step(levers)
        seen_alone, rewards_alone, done_alone, _ = alone.step(levers[:3])
        np.testing.assert_array_equal(seen[:3], seen_alone)
        np.testing.assert_array_equal(rewards[:3], rewards_alone)
        np.testing.assert_array_equal(done[:3], done_alone)
    both.seed(9)
    np.testing.assert_array_equal(both.reset(), first)


def test_the_return_is_minus_the_capped_search_time_in_minutes() -> None:
    group = SearchGroup(SCENARIO.override(**{"ending.time_limit": 200.0}), 8, SearchView(), 0.98)
    group.begin(5)
    clock_at_start = group.world.episode["clock"].copy()
    total, ends = np.zeros(8), {}
    while len(ends) < 8:
        rewards, done = group.beat()
        for env in range(8):
            if env not in ends:
                total[env] += rewards[env]
        for k, env in enumerate(np.flatnonzero(done).tolist()):
            ends.setdefault(env, (group.times[k] if group.successes[k] else 200.0, bool(group.successes[k])))
    for env, (seconds, _) in ends.items():
        assert total[env] == pytest.approx(-(seconds - clock_at_start[env]) / 60.0)
    assert 0 < sum(success for _, success in ends.values()) < 8


def test_what_a_new_episode_costs_before_the_step_ends_is_paid_with_the_next() -> None:
    env = SearchVecEnv([(SCENARIO, 32)], seed=3)
    group, total, clock = env.groups[0], np.zeros(32), np.zeros(32)
    clock[:] = group.world.episode["clock"]
    ended = np.zeros(32, np.bool_)
    for _ in range(14):
        _, rewards, done, infos = env.step(np.zeros((32, N_LEVERS)))
        total += np.where(ended, 0.0, rewards)
        ended |= done
        assert all(("episode" in infos[slot]) == bool(done[slot]) for slot in range(32))
    assert ended.any()
    assert total[~ended] == pytest.approx(-(group.world.episode["clock"] - clock)[~ended] / 60.0)
    assert group.world.episode["seed"][~ended].tolist() == following_seeds(3 + np.arange(32))[~ended].tolist()


def test_sb3_trains_on_it() -> None:
    env = SearchVecEnv([(SCENARIO, 4)], seed=1)
    model = PPO("MlpPolicy", env, n_steps=2, batch_size=8, n_epochs=1, seed=0)
    model.learn(8)
    assert model.num_timesteps == 8
    assert pytest.approx(env.groups[0].world.episode["clock"].max(), abs=5.0) == MACRO_BEATS * 6.0 * 2


@pytest.mark.parametrize(
    ("overrides", "message"),
    [({"radio.radius": 20.0}, "radio: must reach all"), ({"clock": "event"}, "must be 'barrier'")],
)
def test_what_cannot_be_trained_in_is_refused(overrides: dict[str, object], message: str) -> None:
    entry = {"scenario": "rate-60x60x30-random", "overrides": overrides}
    with pytest.raises(InputError, match=message):
        SearchEnvironment.model_validate({"groups": [entry]}).make(0)
