"""The standard interfaces pass their own checkers, and show the same world."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test
from worlds import NOISY, begun, flying, small

import osl_env
from osl_env import InputError, Scenario
from osl_env.envs.spaces import ActionTranslator

MODES: dict[str, dict[str, Any]] = {
    "hop": {},
    "waypoint": {"action": "waypoint"},
    "velocity": {"vehicle": {"kind": "point_mass"}, "action": "velocity"},
    "setpoint": {"vehicle": {"kind": "point_mass"}, "action": "setpoint"},
    "event": {"clock": "event"},
}
SHORT = {"ending.time_limit": 20.0}


def scenario(mode: str, **changes: Any) -> Scenario:
    return small(**SHORT | MODES[mode] | changes)


@pytest.mark.parametrize("observation", ["flat", "physical"])
@pytest.mark.parametrize("mode", MODES)
def test_pettingzoo_parallel_api(mode: str, observation: str) -> None:
    for n_uavs in (1, 2, 3, 4, 5):
        env = osl_env.parallel_env(scenario(mode, **{"team.n_uavs": n_uavs}), observation=observation)
        parallel_api_test(env, num_cycles=60)


@pytest.mark.parametrize("observation", ["flat", "physical"])
@pytest.mark.parametrize("n_uavs", [1, 2, 3, 4, 5])
def test_observations_are_in_their_space(observation: str, n_uavs: int) -> None:
    env = osl_env.parallel_env(small(**{"team.n_uavs": n_uavs}), observation=observation)
    observations, _ = env.reset(seed=1)
    for _ in range(5):
        for agent, seen in observations.items():
            assert env.observation_space(agent).contains(seen)
        assert env.state_space.contains(env.state())
        observations, *_ = env.step(dict.fromkeys(env.agents, 0))


@pytest.mark.parametrize("mode", MODES)
def test_pettingzoo_agent_by_agent_api(mode: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the checker warns about optional features
        api_test(osl_env.env(scenario(mode)), num_cycles=100)


@pytest.mark.parametrize("mode", MODES)
def test_pettingzoo_seeds(mode: str) -> None:
    parallel_seed_test(lambda: osl_env.parallel_env(scenario(mode, **NOISY)))


def test_pettingzoo_registry() -> None:
    if not hasattr(pettingzoo, "register"):
        pytest.skip("this PettingZoo has no registry")
    env = pettingzoo.make("parallel", "osl_env/Team-v0", scenario=small())
    observations, _ = env.reset(seed=1)
    assert sorted(observations) == ["uav_0", "uav_1", "uav_2"]


def test_space_methods_return_the_identical_object() -> None:
    env = osl_env.parallel_env(small())
    for agent in env.possible_agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) is env.action_space(agent)
    assert env.action_space("uav_0") is not env.action_space("uav_1")  # samples must not depend on each other


@pytest.mark.parametrize("observation", ["flat", "physical"])
def test_observations_and_infos_are_fresh_objects(observation: str) -> None:
    env = osl_env.parallel_env(small(), observation=observation)
    first, infos = env.reset(seed=1)
    kept = {
        agent: np.copy(seen) if observation == "flat" else {k: v.copy() for k, v in seen.items()}
        for agent, seen in first.items()
    }
    second, _, _, _, later = env.step(dict.fromkeys(env.agents, 40))
    for agent in env.agents:
        assert first[agent] is not second[agent]
        assert infos[agent] is not later[agent]
        if observation == "flat":
            assert np.array_equal(first[agent], kept[agent])
            assert not np.shares_memory(first[agent], second[agent])
        else:
            assert all(np.array_equal(first[agent][key], kept[agent][key]) for key in kept[agent])


def test_max_cycles_may_be_set() -> None:
    env = osl_env.parallel_env(small(), max_cycles=4)
    for limit in (4, 7):
        env.max_cycles = limit
        env.reset(seed=1)
        steps = 0
        while env.agents:
            *_, truncations, _ = env.step(dict.fromkeys(env.agents, 52))
            steps += 1
        assert steps == env.max_cycles == limit
        assert all(truncations.values())
    with pytest.raises(InputError, match="max_cycles = 0"):
        env.max_cycles = 0


def test_an_empty_battery_terminates_an_agent_and_the_others_stay() -> None:
    settings = {"action": "waypoint", "energy.capacity": 4000.0, "radio.radius": 0}
    env = osl_env.parallel_env(small(**settings))
    env.reset(seed=1)
    here = {agent: 2 * env.world.motion["position"][0, i] / [20, 20, 10] - 1 for i, agent in enumerate(env.agents)}
    actions = {agent: np.array([*place, -1, 0], dtype=np.float32) for agent, place in here.items()}
    actions["uav_1"][:3] = 1.0
    _, _, terminations, truncations, _ = env.step(actions)
    assert terminations == {"uav_0": False, "uav_1": True, "uav_2": False}
    assert not any(truncations.values())
    assert env.agents == ["uav_0", "uav_2"]
    observations, rewards, *_ = env.step(actions)
    assert set(observations) == set(rewards) == {"uav_0", "uav_2"}


@pytest.mark.parametrize("clock", ["barrier", "event"])
def test_success_ends_the_whole_team(clock: str) -> None:
    env = osl_env.parallel_env(small(clock=clock, **{"team.starts": [(12.0, 13.0, 5.0)] * 3}))
    env.reset(seed=1)
    _, rewards, terminations, _, infos = env.step({"uav_0": 52, "uav_1": 53, "uav_2": 0})
    assert all(terminations.values())
    assert env.agents == []
    assert all(info["success"] for info in infos.values())
    assert all(reward == 20.0 for reward in rewards.values())
    with pytest.raises(InputError, match="reset"):
        env.step({})


def test_infos_hold_numbers_with_constant_keys() -> None:
    env = osl_env.parallel_env(scenario("hop"))
    _, infos = env.reset(seed=1)
    keys = {"clock", "search_time", "energy", "success"}
    while env.agents:
        assert all(set(info) == keys for info in infos.values())
        assert all(isinstance(value, int | float) for info in infos.values() for value in info.values())
        *_, infos = env.step(dict.fromkeys(env.agents, 30))


def test_the_next_reset_begins_another_episode_reproducibly() -> None:
    def seeds() -> list[int]:
        env = osl_env.parallel_env(small())
        env.reset(seed=5)
        numbers = []
        for _ in range(3):
            numbers.append(int(env.world.episode["seed"][0]))
            env.reset()
        return numbers

    assert seeds() == seeds()
    assert len(set(seeds())) == 3


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["osl_env/Solo-v0", "osl_env/Team-v0"])
def test_gymnasium_checker(name: str, mode: str) -> None:
    env = gym.make(name, scenario=scenario(mode), render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*flattened array.*|.*not within the observation space.*")
        check_env(env.unwrapped)
    env.close()
    env.close()


@pytest.mark.parametrize("name", ["osl_env/Solo-v0", "osl_env/Team-v0"])
def test_gym_make_by_preset_name_with_overrides(name: str) -> None:
    env = gym.make(name, scenario="rate-60x60x30", max_episode_steps=3, **{"team.n_uavs": 2})
    env.reset(seed=1)
    assert env.unwrapped.world.n_uavs == (1 if "Solo" in name else 2)  # type: ignore[attr-defined]
    flags = [env.step(env.action_space.sample() * 0)[3] for _ in range(3)]
    assert flags == [False, False, True]


@pytest.mark.parametrize("mode", ["hop", "waypoint", "velocity", "setpoint"])
def test_team_and_parallel_views_show_the_same_world(mode: str) -> None:
    team, parallel = gym.make("osl_env/Team-v0", scenario=scenario(mode)), osl_env.parallel_env(scenario(mode))
    seen, _ = team.reset(seed=3)
    observations, _ = parallel.reset(seed=3)
    assert np.array_equal(seen, np.concatenate([observations[agent] for agent in parallel.possible_agents]))
    team.action_space.seed(0)
    ended = False
    while not ended:
        assert np.array_equal(seen, parallel.state())
        action = team.action_space.sample()
        parts = dict(zip(parallel.possible_agents, np.asarray(action).reshape(3, -1), strict=True))
        if mode == "hop":
            parts = {agent: part.item() for agent, part in parts.items()}
        seen, reward, terminated, truncated, _ = team.step(action)
        _, rewards, *_ = parallel.step(parts)
        assert reward == pytest.approx(sum(rewards.values()) / 3, abs=1e-12)
        ended = terminated or truncated
    assert not parallel.agents


@pytest.mark.parametrize("mode", ["hop", "waypoint", "velocity", "setpoint"])
@pytest.mark.parametrize("name", ["Solo", "Team"])
def test_stable_baselines3_checker(name: str, mode: str) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        checker.check_env(gym.make(f"osl_env/{name}-v0", scenario=scenario(mode)))


def test_action_masks_tell_which_hops_are_flown_as_they_are() -> None:
    env = osl_env.parallel_env(small(**{"vehicle.hop_lengths": 3, "ending.time_limit": 400.0}))
    env.reset(seed=2)
    rng, seen = np.random.default_rng(0), set()
    while env.agents:
        masks = {agent: env.action_mask(agent) for agent in env.agents}
        before = env.world.motion["position"][0].copy()
        actions = {agent: int(rng.choice([rng.integers(0, 79), 6 * 3 + 2])) for agent in env.agents}  # or 3 steps off
        env.step(actions)
        for agent, action in actions.items():
            uav = int(agent[4:])
            intended = before[uav] + env.world.hop_offsets[action]
            arrived = np.array_equal(env.world.motion["position"][0, uav], intended)
            assert arrived == bool(masks[agent][action])
            seen.add(arrived)
            assert masks[agent].shape == (80,)
            assert masks[agent][78:].all()  # hovering and declaring are always allowed
    assert seen == {True, False}


def test_masks_of_the_other_views_are_the_same() -> None:
    team = gym.make("osl_env/Team-v0", scenario=small()).unwrapped
    vector = osl_env.make_vec(small(), 2)
    parallel = osl_env.parallel_env(small())
    team.reset(seed=1)
    vector.reset(seed=[1, 2])
    parallel.reset(seed=1)
    masks = np.concatenate([parallel.action_mask(agent) for agent in parallel.agents])
    assert team.action_masks().tolist() == masks.astype(bool).tolist()  # type: ignore[attr-defined]
    assert vector.action_masks()[0].reshape(-1).tolist() == masks.astype(bool).tolist()
    with pytest.raises(InputError, match="only for action 'hop'"):
        osl_env.make_vec(flying(), 2).action_masks()


BAD_ARGUMENTS: list[dict[str, Any]] = [
    {"render_mode": "human"}, {"observation": "pixels"}, {"max_cycles": 0}, {"colour": "red"}, {"team.n_uavs": 0},
]  # fmt: skip


@pytest.mark.parametrize("arguments", BAD_ARGUMENTS)
def test_bad_arguments_are_refused_in_one_line(arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        osl_env.parallel_env(small(), **arguments)
    assert "\n" not in str(caught.value)
    assert next(iter(arguments)).split(".")[-1].removeprefix("max_") in str(caught.value) or "max_decisions" in str(
        caught.value
    )


# action of one UAV, by mode, that must be refused
BAD_ACTIONS: list[tuple[str, Any]] = [
    ("hop", 54),
    ("hop", -1),
    ("hop", 2.0),
    ("hop", "up"),
    ("hop", None),
    ("hop", True),
    ("hop", [1]),
    ("hop", np.zeros((9, 9))),
    ("hop", np.float64(3)),
    ("hop", 10**30),
    ("waypoint", np.zeros(4, np.float32)),
    ("waypoint", np.zeros((5, 1), np.float32)),
    ("waypoint", np.full(5, np.nan, np.float32)),
    ("waypoint", np.full(5, 1.01, np.float32)),
    ("waypoint", np.full(5, -np.inf, np.float32)),
    ("waypoint", 0.0),
    ("waypoint", ["a"] * 5),
    ("waypoint", None),
    ("waypoint", np.zeros(5, complex)),
    ("velocity", np.zeros(5, np.float32)),
    ("velocity", np.full(4, np.nan, np.float32)),
    ("velocity", [0.0, 0.0, 2.0, 0.0]),
    ("velocity", "north"),
    ("setpoint", np.zeros(3, np.float32)),
    ("setpoint", np.full(4, np.nan, np.float32)),
    ("setpoint", [0.0, 1.5, 0.0, 0.0]),
    ("setpoint", "home"),
]


@pytest.mark.parametrize("view", ["parallel", "team", "vector"])
@pytest.mark.parametrize(("mode", "bad"), BAD_ACTIONS)
def test_bad_actions_are_refused_in_one_line_and_change_nothing(view: str, mode: str, bad: Any) -> None:
    good: Any = 0 if mode == "hop" else np.zeros(5 if mode == "waypoint" else 4, np.float32)
    env: Any
    if view == "parallel":
        env = osl_env.parallel_env(scenario(mode))
        actions: Any = {"uav_0": good, "uav_1": bad, "uav_2": good}
    elif view == "team":
        env = osl_env.envs.single.TeamEnv(scenario(mode))
        actions = [good, bad, good] if mode == "hop" else joined([good, bad, good])
    else:
        env = osl_env.make_vec(scenario(mode), 1)
        actions = [[good, bad, good]] if mode == "hop" else [joined([good, bad, good])]
    if view != "parallel" and bad is True:
        pytest.skip("in an array of integers, True is one of them")
    env.reset(seed=1)
    world = env.world
    before = [world.motion.tobytes(), world.ledger.tobytes(), world.senses.tobytes(), world.episode.tobytes()]
    with pytest.raises(InputError) as caught:
        env.step(actions)
    message = str(caught.value)
    assert "\n" not in message
    assert "action" in message
    assert before == [world.motion.tobytes(), world.ledger.tobytes(), world.senses.tobytes(), world.episode.tobytes()]


def joined(parts: list[Any]) -> Any:
    """The parts in a row; as they are if they do not fit together."""
    try:
        return np.concatenate([np.atleast_1d(part) for part in parts])
    except (ValueError, TypeError):
        return parts


def test_a_missing_action_is_named() -> None:
    env = osl_env.parallel_env(small())
    env.reset(seed=1)
    for actions in ({"uav_0": 0, "uav_2": 0}, {}, None, 5):
        with pytest.raises(InputError, match="there is none for 'uav_"):
            env.step(actions)  # type: ignore[arg-type]


def test_steps_before_a_reset_are_refused() -> None:
    for env in (osl_env.parallel_env(small()), osl_env.envs.single.TeamEnv(small()), osl_env.make_vec(small(), 2)):
        with pytest.raises(InputError, match="reset"):
            env.step(np.zeros((2, 3), np.int64))  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "one", True])
def test_bad_seeds_are_refused_by_all_views(seed: Any) -> None:
    for env in (osl_env.parallel_env(small()), osl_env.make_vec(small(), 2)):
        with pytest.raises(InputError, match="seed"):
            env.reset(seed=seed)


def test_box_actions_mean_what_the_table_says() -> None:
    world = begun(small(action="waypoint"))
    actions = np.array([[[-1, -1, -1, -1, 0], [1, 1, 1, 1, 0.95], [0, 0, 0, 0, -1]]], np.float32)
    ActionTranslator(world).step(actions)
    assert world.motion["position"][0].tolist() == [[0, 0, 0], [20, 20, 10], [10, 10, 5]]
    assert world.senses["sampling_time"][0].tolist() == [1.0, 20.0, 10.0 if np.rint(9.5) == 9 else 11.0]
    actions[0, 1, 4] = 1.0
    ActionTranslator(world).step(actions)
    assert world.episode["declared"][0].tolist() == [20.0, 20.0, 10.0]


def test_setpoint_actions_are_offsets_in_units_of_the_lookahead() -> None:
    vehicle = {"kind": "point_mass", "position_gain": 0.5, "acceleration": 1000.0, "physics_step": 0.001}
    world = begun(flying(action="setpoint", vehicle=vehicle))
    before = world.motion["position"][0].copy()
    actions = np.array([[[1, 0, 0, 0], [0, -0.5, 0, 0.95], [0, 0, 0, -1]]], np.float32)
    ActionTranslator(world).step(actions)
    # after 1 s, exp(-0.5) of an offset of 2 m is left; the step is of first order, and its error about 0.02 %
    gone = 2.0 * (1.0 - np.exp(-0.5))
    np.testing.assert_allclose(
        world.motion["position"][0] - before, [[gone, 0, 0], [0, -gone / 2, 0], [0, 0, 0]], rtol=5e-4, atol=1e-12
    )
    here = world.motion["position"][0, 1].copy()
    actions[0, 1, 3] = 1.0
    ActionTranslator(world).step(actions)
    assert world.episode["declared"][0].tolist() == here.tolist()


@pytest.mark.parametrize("mode", MODES)
def test_render_gives_a_picture(mode: str) -> None:
    env = osl_env.parallel_env(scenario(mode), render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    shape = env.action_space(env.agents[0]).shape
    env.step({agent: np.full(shape, 0.5, np.float32) if shape else 45 for agent in env.agents})  # none declares
    second = env.render()
    for image in (first, second):
        assert image is not None
        assert image.dtype == np.uint8
        assert image.ndim == 3
        assert image.shape[2] == 3
        assert image.std() > 5
    assert not np.array_equal(first, second)
    assert osl_env.parallel_env(scenario(mode)).render() is None


def test_render_without_wind_or_smell() -> None:
    calm = {"wind.velocity": (0, 0, 0), "plume.source_strength": 1e-9, "team.n_uavs": 1}
    env = gym.make("osl_env/Team-v0", scenario=small(**calm), render_mode="rgb_array")
    env.reset(seed=1)
    image: Any = env.render()
    assert image.std() > 5
