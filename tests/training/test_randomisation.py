"""Randomised scenarios: what is drawn, when, and how an environment exchanges its groups for newly drawn ones."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from osl_env.errors import InputError

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import PPO

from baselines.features import make_spec
from training.randomisation import Randomisation, Variation, varied
from training.sb3_vec_env import UavVecEnv

torch.set_num_threads(1)
CONTENT: dict[str, Any] = {
    "scenario": "rate-100x60x30",
    "overrides": {"ending.time_limit": 20.0},
    "groups": 4,
    "redraw": 1.0,
    "redraw_every": 1,
    "vary": {
        "team.n_uavs": {"choices": [1, 2, 5, 8]},
        "arena.size": {"low": [30, 30, 20], "high": [90, 60, 30]},
        "plume.source_strength": {"low": 1.0, "high": 100.0, "log": True},
        "wind.speed": [0.5, 2.0],
        "wind.direction": [0.0, 6.28],
        "starts": {"choices": ["anywhere", "corner"]},
        "sources": {"choices": ["anywhere"]},
        "mismatch.source_strength": {"low": 0.5, "high": 2.0, "log": True},
        "mismatch.diffusivity": [0.5, 2.0],
        "gas_sensor.miss_probability": [0.0, 0.3],
        "anemometer.noise": [0.0, 0.2],
        "radio.radius": {"choices": [10.0, math.inf]},
    },
    "curriculum": [
        {"until": 0.25, "vary": {"team.n_uavs": {"choices": [2]}, "mismatch.source_strength": {"choices": [1.0]}}}
    ],
}
FEATURES = make_spec([{"kind": "raw"}, {"kind": "belief", "particles": 16}])


def made(**changes: Any) -> Randomisation:
    return Randomisation.model_validate(CONTENT | changes)


def test_a_draw_covers_every_range_evenly() -> None:
    config = made()
    scenarios = config.draw(0.5, 400, np.random.default_rng(0))
    counts = np.bincount([scenario.team.n_uavs for scenario in scenarios])
    assert counts[[1, 2, 5, 8]].tolist() == [100] * 4  # Latin hypercube: exactly
    logs = np.log10([scenario.plume.source_strength for scenario in scenarios])
    assert np.histogram(logs, bins=4, range=(0.0, 2.0))[0].tolist() == [100] * 4
    speeds = np.array([scenario.wind.speed for scenario in scenarios])
    assert np.histogram(speeds, bins=4, range=(0.5, 2.0))[0].tolist() == [100] * 4
    assert abs(np.corrcoef(logs, speeds)[0, 1]) < 0.15  # 3 standard errors
    sides = np.array([scenario.arena.size for scenario in scenarios])
    assert (sides.min(axis=0) >= [30, 30, 20]).all()
    assert (sides.max(axis=0) <= [90, 60, 30]).all()
    for scenario in scenarios[:20]:
        advertised = scenario.advertised_plume
        assert advertised is not None
        assert 0.5 <= advertised.source_strength / scenario.plume.source_strength <= 2.0
        assert advertised.lifetime == scenario.plume.lifetime
        assert scenario.sources.region == ((0.0, 0.0, 0.0), scenario.arena.size)


def test_a_draw_is_a_function_of_the_generator() -> None:
    draws = [made().draw(0.5, 8, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert draws[0] == draws[1]
    assert draws[0] != draws[2]


def test_the_curriculum_goes_by_progress() -> None:
    config = made()
    early = config.draw(0.24, 8, np.random.default_rng(0))
    late = config.draw(0.25, 8, np.random.default_rng(0))
    assert {scenario.team.n_uavs for scenario in early} == {2}
    assert {scenario.team.n_uavs for scenario in late} == {1, 2, 5, 8}
    assert all(scenario.advertised_plume.source_strength == scenario.plume.source_strength for scenario in early)  # type: ignore[union-attr]
    assert config.max_uavs == 8


def test_places_are_stretched_with_the_area() -> None:
    base = made().base()
    scenario = varied(base, {"arena.size": [50.0, 30.0, 30.0], "starts": "scenario"})
    np.testing.assert_allclose(scenario.team.starts, np.array(base.team.starts) * [0.5, 0.5, 1.0])
    np.testing.assert_allclose(scenario.sources.positions, np.array(base.sources.positions) * [0.5, 0.5, 1.0])
    corner = varied(base, {"arena.size": [30.0, 60.0, 30.0], "starts": "corner"})
    np.testing.assert_allclose(corner.team.region, [[0, 0, 0], [10, 20, 10]])
    assert varied(base, {}) == base
    assert varied(base, {"wind.speed": 2.0}).wind.velocity == pytest.approx((0.0, -2.0, 0.0))


def test_values_at_the_ends() -> None:
    zero, one = np.zeros(3), np.full(3, 1.0 - 1e-12)
    assert Variation.model_validate([1.0, 3.0]).at(zero) == 1.0
    whole = Variation(low=1, high=3, integer=True)
    assert [whole.at(zero), whole.at(one)] == [1, 3]
    assert Variation(choices=("a", "b")).at(one) == "b"
    assert Variation(low=(1.0, 2.0), high=(3.0, 2.0)).at(one) == pytest.approx([3.0, 2.0])


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ({"plume.strenght": [1, 2]}, "strenght"),
        ({"plume.source_strength": [-1, 2]}, "source_strength"),
        ({"vehicle.hop_lengths": {"choices": [1, 2]}}, "action space"),
        ({"starts": {"choices": ["everywhere"]}}, "everywhere"),
        ({"sources": {"choices": ["corner"]}}, "corner"),
        ({"mismatch.colour": [1, 2]}, "colour"),
        ({"wind.speed": [-1, 2]}, "wind.speed"),
        ({"arena.size": [10, 20]}, "three sides"),
        ({"team.n_uavs": {"choices": [9]}}, "starts"),
    ],
)
def test_bad_values_are_refused_before_training(vary: dict[str, Any], said: str) -> None:
    config = Randomisation.model_validate({"scenario": "rate-60x60x30", "vary": vary})
    with pytest.raises(InputError, match=said) as refusal:
        UavVecEnv(config, 8)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "content",
    [
        {"vary": {"wind.speed": {"low": 2, "high": 1}}},
        {"vary": {"wind.speed": {"low": 0, "high": 1, "log": True}}},
        {"vary": {"wind.speed": {"choices": []}}},
        {"vary": {"wind.speed": {"choices": [1], "low": 1, "high": 2}}},
        {"vary": {"wind.speed": {"lo": 1}}},
        {"vary": {"wind.speed": {"low": "slow", "high": "fast"}}},
        {"curriculum": [{"until": 0.5}, {"until": 0.5}]},
        {"curriculum": [{"vary": {}}]},
        {"sceanrio": "x"},
    ],
)
def test_bad_configurations_are_refused(content: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        Randomisation.model_validate({"scenario": "rate-60x60x30"} | content)


def check_contract(env: UavVecEnv, redraw: bool, rng: np.random.Generator) -> None:
    """One step: an episode never goes on across an exchange, and idle slots show nothing."""
    resting = env.idle
    rows, rewards, dones, infos = env.step(rng.integers(0, env.action_space.n - 1, env.num_envs))
    assert rows.shape == (env.num_envs, env.size)
    assert not rewards[resting].any()
    assert not rows[env.idle].any()
    assert (rows[~env.idle, 12] == 1.0).all()  # `ready`: those that fly observe themselves
    for slot in range(env.num_envs):
        assert ("terminal_observation" in infos[slot]) == dones[slot]
        assert infos[slot].get("idle", False) == resting[slot]
        if dones[slot] and resting[slot]:
            assert not infos[slot]["terminal_observation"].any()
    if redraw:
        assert dones.all()
        cut = [info for info, rested in zip(infos, resting, strict=True) if not rested and "episode" in info]
        assert cut
        assert any(info["TimeLimit.truncated"] and info["terminal_observation"].any() for info in cut)


def test_groups_are_exchanged_within_a_step() -> None:
    env = UavVecEnv(made(), 12, FEATURES, seed=3)
    assert env.num_envs == 4 * 3 * 3
    env.reset()
    rng, teams = np.random.default_rng(0), []
    for step in range(30):
        if step in (8, 16, 24):
            env.redraw(step / 30)
        check_contract(env, step in (8, 16, 24), rng)
        teams.append(tuple(group.world.n_uavs for group in env.groups))
    assert set(teams[0]) == {2}  # the curriculum
    assert sorted(teams[8]) == sorted(teams[16]) == [1, 2, 5, 8]
    assert env.get_attr("scenario", [0])[0] is env.groups[0].scenario


def test_a_share_of_the_groups_is_exchanged_the_oldest_first() -> None:
    env = UavVecEnv(made(), 12, FEATURES)
    env.reset()
    before = list(env.groups)
    for expected in ([0], [0, 1], [0, 1, 2]):
        env.redraw(1.0, share=0.25)
        dones = env.step(np.full(env.num_envs, 26))[2]
        changed = [k for k, group in enumerate(env.groups) if group is not before[k]]
        assert changed == expected
        assert dones.reshape(4, -1).all(axis=1).tolist()[expected[-1]]
    with pytest.raises(InputError, match="share"):
        env.redraw(0.5, share=0.0)


def test_groups_are_flown_before_they_are_exchanged() -> None:
    env = UavVecEnv(made(redraw=0.5, redraw_every=5), 12, make_spec([{"kind": "raw"}]))
    env.reset()
    changed = []
    for _ in range(12):
        before = list(env.groups)
        env.redraw(0.5)
        env.step(np.full(env.num_envs, 26))
        changed.append(sum(group is not old for group, old in zip(env.groups, before, strict=True)))
    assert changed == [0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0]


def test_a_resumed_environment_goes_on_alike() -> None:
    env = UavVecEnv(made(), 12, FEATURES, seed=3)
    env.reset()
    env.redraw(0.6)
    rng = np.random.default_rng(0)
    for _ in range(5):
        env.step(rng.integers(0, env.action_space.n - 1, env.num_envs))
    state = json.loads(json.dumps(env.state_dict()))
    twins = []
    for _ in range(2):
        twin = UavVecEnv(made(), 12, FEATURES, seed=3)
        twin.load_state_dict(state)
        twins.append([twin.reset()])
        assert twin.state_dict() == env.state_dict()
        twin.redraw(0.9)
        moves = np.random.default_rng(1)
        twins[-1] += [twin.step(moves.integers(0, 27, twin.num_envs))[0] for _ in range(10)]
    for first, second in zip(*twins, strict=True):
        np.testing.assert_array_equal(first, second)


def test_sb3_learns_while_scenarios_change() -> None:
    env = UavVecEnv(made(), 12, make_spec([{"kind": "raw"}]))
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=96, n_epochs=1, seed=0, device="cpu",
                policy_kwargs={"net_arch": [8]})  # fmt: skip
    for progress in (0.0, 0.5, 1.0):
        env.redraw(progress)
        model.learn(env.num_envs * 8 * 2, reset_num_timesteps=False)
    assert model.num_timesteps == env.num_envs * 8 * 6
