"""Trainings relative to the wind: what is trained is what flies, and the memory beside the observation is exact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import numpy as np
import torch
from gymnasium import spaces
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from tiny_training import config

from baselines import make_policy
from baselines.learned.course import Course, WindFrame
from osl_env import InputError
from training.algorithms import make_model
from training.course_vec_env import CourseVecEnv
from training.flight import fly
from training.held_out import make_checkpoint
from training.recurrent_policy import BesideLstmPolicy
from training.sb3_vec_env import UavVecEnv
from training.train import train

RAW = [{"kind": "raw", "neighbours": 1}, {"kind": "hits", "length": 2}]
# computing is not charged in training; the network's own declarations would end the episodes
TASK = {"team.n_uavs": 2, "ending.max_decisions": 6, "energy.switched_capacitance": 0.0, "wind.random_direction": True}


def course_config(**changes: Any) -> Any:
    environment = {
        "kind": "course",
        "scenarios": ["rate-60x60x30-random"],
        "overrides": TASK,
        "n_worlds": 3,
        "features": RAW,
        "course": {"lengths": [4.0], "samples": 2, "hover_samples": 3},
    }
    network = {"kind": "lstm", "memory": 5, "layers": [8], "beside": True, "last_logit": -20.0}
    return config("recurrent-ppo", environment=environment, network=network, **changes)


def test_a_checkpoint_flies_as_its_network_was_trained(tmp_path: Path) -> None:
    made = course_config()
    env = made.environment.make(0)
    model = make_model(made, env)
    folder = make_checkpoint(model, made, command="", seconds=0.0).write(tmp_path / "course")
    world = env.groups[0].world
    env.seed(7)
    observations, state, tracks = env.reset(), None, []
    seeds = world.episode["seed"].tolist()
    starts = np.ones(env.num_envs, np.bool_)
    for _ in range(6):
        tracks.append(world.motion["position"].copy())
        actions, state = model.predict(observations, state, starts, deterministic=True)
        observations, _, starts, _ = env.step(actions)
    flown: list[np.ndarray] = []
    scenario = made.environment.made()[0]
    fly(
        make_policy("checkpoint", path=folder),
        scenario,
        seeds,
        watch=lambda w: flown.append(w.motion["position"].copy()),
    )
    assert len(flown) == 7
    np.testing.assert_allclose(flown[:6], tracks, atol=1e-6)
    assert np.ptp(tracks, axis=0).max() > 3.0


def test_a_course_training_learns_and_ships(tmp_path: Path) -> None:
    evaluation = {
        "scenario": "rate-60x60x30",
        "overrides": TASK,
        "seeds": {"count": 2},
        "every": 72,
        "stochastic": True,
    }
    result = train(course_config(evaluation=evaluation), tmp_path / "run")
    assert result.steps == 144
    policy = make_policy("checkpoint", path=result.checkpoint)
    fly(policy, evaluation_scenario(), [1])


def evaluation_scenario() -> Any:
    return course_config().environment.made()[0]


def test_observations_are_those_of_the_plain_environment_turned() -> None:
    scenario = evaluation_scenario()
    plain, course = UavVecEnv(scenario.override(action="waypoint"), 3, RAW), CourseVecEnv(scenario, 3, RAW)
    frame, definition = WindFrame(plain.features), Course()
    np.testing.assert_array_equal(course.reset(), frame.turned(plain.reset()))
    rng = np.random.default_rng(1)
    finals = 0
    for _ in range(14):
        actions = rng.integers(definition.n_actions - 1, size=6)
        world = plain.groups[0].world
        boxes = definition.boxes(
            actions, world.motion["position"].reshape(-1, 3), world.senses["wind"].reshape(-1, 3),
            world.senses["reading"].reshape(-1),
            np.array(scenario.arena.size), scenario.vehicle.max_samples,
        )  # fmt: skip
        there, here = plain.step(boxes), course.step(actions)
        np.testing.assert_array_equal(here[0], frame.turned(there[0]))
        np.testing.assert_array_equal(here[1], there[1])
        np.testing.assert_array_equal(here[2], there[2])
        for slot in np.flatnonzero(here[2]):
            finals += 1
            last = there[3][slot]["terminal_observation"]
            np.testing.assert_array_equal(here[3][slot]["terminal_observation"], frame.turned(last[None])[0])
    assert finals >= 12


@pytest.mark.parametrize("actions", [[0, 1], np.zeros(6), [0, 0, 0, 0, 0, 22], [0, 0, 0, 0, 0, -1]])
def test_bad_actions_are_refused(actions: Any) -> None:
    env = CourseVecEnv(evaluation_scenario(), 3, RAW)
    env.reset()
    with pytest.raises(InputError, match="actions: must be"):
        env.step(np.array(actions))


def test_whole_sequences_give_what_single_steps_give() -> None:
    lstm = torch.nn.LSTM(3, 4)
    generator = torch.Generator().manual_seed(1)
    features = torch.randn(2 * 5, 3, generator=generator)
    states = (torch.randn(1, 2, 4, generator=generator), torch.randn(1, 2, 4, generator=generator))
    for starts in ([1, 0, 0, 0, 0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 1, 0, 0, 0, 1]):
        marks = torch.tensor(starts, dtype=torch.float32)
        expected, last = RecurrentActorCriticPolicy._process_sequence(features, states, marks, lstm)
        found, end = BesideLstmPolicy._process_sequence(features, states, marks, lstm)
        torch.testing.assert_close(found, torch.cat([expected, features], dim=1))
        torch.testing.assert_close(end, last)


def test_the_last_action_begins_rare_and_all_weights_are_trained() -> None:
    policy = BesideLstmPolicy(
        spaces.Box(-1.0, 1.0, (3,)),
        spaces.Discrete(4),
        lambda _: 1e-3,
        net_arch=[8],
        lstm_hidden_size=5,
        last_logit=-4.0,
    )
    assert policy.action_net.bias.tolist() == [0.0, 0.0, 0.0, -4.0]
    trained = {id(weights) for group in policy.optimizer.param_groups for weights in group["params"]}
    assert trained == {id(weights) for weights in policy.parameters()}
