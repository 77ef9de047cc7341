"""The numpy forward pass repeats torch's, and does not depend on the batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import gymnasium as gym
import torch
from gymnasium import spaces
from sb3_contrib import RecurrentPPO
from stable_baselines3 import DQN, PPO, SAC
from torch import nn

from baselines.learned.network import Architecture, Network
from osl_env import InputError
from training.networks import TeamExtractor, exported

SIZE, SLOTS, SLOT = 30, 3, 6  # numbers of an observation, and of the neighbours' entries in it
TEAM = {"start": 7, "slots": SLOTS, "slot_size": SLOT, "embedding": 16}
DISCRETE, BOX = spaces.Discrete(9), spaces.Box(-1.0, 1.0, (4,), np.float32)


class Bare(gym.Env[Any, Any]):
    """Spaces, and nothing else."""

    def __init__(self, action_space: spaces.Space[Any]) -> None:
        self.observation_space = spaces.Box(-1.0, 1.0, (SIZE,), np.float32)
        self.action_space = action_space


def team(pooling: str, activation: str = "tanh") -> dict[str, Any]:
    keywords = {"team": TEAM | {"pooling": pooling}, "activation": activation}
    return {"features_extractor_class": TeamExtractor, "features_extractor_kwargs": keywords}


RELU = {"activation_fn": nn.ReLU, "net_arch": [20, 12]}
MODELS: dict[str, tuple[Any, str, spaces.Space[Any], dict[str, Any]]] = {
    "ppo hop": (PPO, "MlpPolicy", DISCRETE, {}),
    "ppo hop, relu": (PPO, "MlpPolicy", DISCRETE, RELU),
    "ppo hop, linear": (PPO, "MlpPolicy", DISCRETE, {"net_arch": []}),
    "ppo box": (PPO, "MlpPolicy", BOX, {"net_arch": {"pi": [33], "vf": [5]}}),
    "dqn": (DQN, "MlpPolicy", DISCRETE, {}),
    "dqn, tanh": (DQN, "MlpPolicy", DISCRETE, {"activation_fn": nn.Tanh, "net_arch": [17]}),
    "sac": (SAC, "MlpPolicy", BOX, {"net_arch": [24, 24]}),
    "lstm hop": (RecurrentPPO, "MlpLstmPolicy", DISCRETE, {"lstm_hidden_size": 13}),
    "lstm box": (RecurrentPPO, "MlpLstmPolicy", BOX, {"lstm_hidden_size": 8, "n_lstm_layers": 2, **RELU}),
    "team attention": (PPO, "MlpPolicy", DISCRETE, team("attention")),
    "team mean": (PPO, "MlpPolicy", DISCRETE, team("mean")),
    "team max": (PPO, "MlpPolicy", BOX, team("max")),
    "team attention, dqn": (DQN, "MlpPolicy", DISCRETE, team("attention", "relu")),
    "team attention, sac": (SAC, "MlpPolicy", BOX, team("attention", "relu")),
    "team lstm": (RecurrentPPO, "MlpLstmPolicy", DISCRETE, {"lstm_hidden_size": 9} | team("attention")),
}


def model(name: str) -> Any:
    """The SB3 model, its weights enlarged so that logits and means differ from 0."""
    algorithm, policy, action_space, keywords = MODELS[name]
    sizes = {"buffer_size": 10} if algorithm in (DQN, SAC) else {}
    made = algorithm(policy, Bare(action_space), policy_kwargs=keywords, seed=3, device="cpu", **sizes)
    with torch.no_grad():
        for weights in made.policy.parameters():
            weights.mul_(1.5).add_(0.1 * torch.randn_like(weights))
    return made


def network(made: Any) -> Network:
    architecture, arrays = exported(made)
    return Network(Architecture.parse(architecture, "test"), arrays)


def observations(n: int, seed: int = 0) -> Any:
    """Random observations (n, SIZE) in which 0 to SLOTS neighbours are present."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-1.0, 1.0, (n, SIZE)).astype(np.float32)
    slots = rows[:, 7 : 7 + SLOTS * SLOT].reshape(n, SLOTS, SLOT)
    absent = np.arange(SLOTS) >= (np.arange(n) % (SLOTS + 1))[:, None]
    slots[..., 0] = 1.0
    slots[absent] = 0.0
    rows[:, 7 : 7 + SLOTS * SLOT] = slots.reshape(n, -1)
    return rows


def torch_outputs(made: Any, rows: Any) -> Any:
    """The head's numbers of a feed-forward `made` as torch gives them."""
    policy, inputs = made.policy, torch.as_tensor(rows)
    with torch.no_grad():
        if isinstance(made, DQN):
            return policy.q_net(inputs).numpy()
        if isinstance(made, SAC):
            return policy.actor.get_action_dist_params(inputs)[0].numpy()
        latent = policy.mlp_extractor.forward_actor(policy.extract_features(inputs, policy.pi_features_extractor))
        return policy.action_net(latent).numpy()


@pytest.mark.parametrize("name", [name for name in MODELS if "lstm" not in name])
def test_the_forward_pass_is_that_of_torch(name: str) -> None:
    made, rows = model(name), observations(64)
    twin = network(made)
    outputs, _ = twin.forward(rows, twin.start(64))
    expected = torch_outputs(made, rows)
    assert np.ptp(expected) > 0.1
    assert outputs.dtype == np.float32
    np.testing.assert_allclose(outputs, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", MODELS)
def test_greedy_actions_are_those_of_predict(name: str) -> None:
    made = model(name)
    twin = network(made)
    state, memory, start = twin.start(5), None, np.ones(5, bool)
    for step in range(12):
        rows = observations(5, seed=step)
        actions, state = twin.greedy(rows, state)
        expected, memory = made.predict(rows, memory, start, deterministic=True)
        np.testing.assert_allclose(actions, expected, atol=1e-5)
        start = np.zeros(5, bool)


@pytest.mark.parametrize("name", [name for name in MODELS if "lstm" in name])
def test_an_lstm_follows_torch_over_a_sequence(name: str) -> None:
    made = model(name)
    twin = network(made)
    layers, size = made.policy.lstm_actor.num_layers, made.policy.lstm_actor.hidden_size
    memory = (torch.zeros(layers, 4, size), torch.zeros(layers, 4, size))
    state = twin.start(4)
    for step in range(20):
        rows = observations(4, seed=step)
        outputs, state = twin.forward(rows, state)
        with torch.no_grad():
            distribution, memory = made.policy.get_distribution(torch.as_tensor(rows), memory, torch.zeros(4))
        inner = distribution.distribution
        if name == "lstm box":
            np.testing.assert_allclose(outputs, inner.mean.numpy(), atol=1e-5, rtol=1e-5)
        else:
            shifted = outputs - np.log(np.exp(outputs).sum(axis=1, keepdims=True))
            np.testing.assert_allclose(shifted, inner.logits.numpy(), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("name", MODELS)
def test_a_row_does_not_depend_on_its_batch(name: str) -> None:
    twin, rows = network(model(name)), observations(37)
    first, state = twin.forward(rows, twin.start(37))
    second, after = twin.forward(rows[::-1].copy(), state)
    for row in range(37):
        alone, memory = twin.forward(rows[row : row + 1], twin.start(1))
        assert alone.tobytes() == first[row].tobytes()
        again, memory = twin.forward(rows[36 - row : 37 - row], state[row : row + 1])
        assert again.tobytes() == second[row].tobytes()
        assert memory.tobytes() == after[row].tobytes()


@pytest.mark.parametrize("name", ["ppo hop", "ppo box", "sac"])
def test_draws_have_the_distribution_of_torch(name: str) -> None:
    made, n = model(name), 4000
    twin, rows = network(made), np.repeat(observations(1), n, axis=0)
    drawn, _ = twin.drawn(rows, twin.start(n), [np.random.default_rng(k) for k in range(n)])
    torch.manual_seed(1)
    expected, _ = made.predict(rows, deterministic=False)
    if name == "ppo hop":
        shares = np.bincount(drawn, minlength=9) / n
        reference = np.bincount(expected, minlength=9) / n
        assert np.abs(shares - reference).max() < 4 * np.sqrt(2 * 0.25 / n)  # 4 standard errors of a difference
    else:
        error = np.sqrt((drawn.var(axis=0) + expected.var(axis=0)) / n)
        assert (np.abs(drawn.mean(axis=0) - expected.mean(axis=0)) < 4 * error).all()
        np.testing.assert_allclose(drawn.std(axis=0), expected.std(axis=0), rtol=0.1)


def test_neighbours_count_as_a_set_and_masked_ones_not_at_all() -> None:
    for name in ("team attention", "team mean", "team max"):
        twin, row = network(model(name)), observations(4)[3:4]
        entries = row[:, 7 : 7 + SLOTS * SLOT].reshape(SLOTS, SLOT)
        swapped, hidden = row.copy(), row.copy()
        swapped[:, 7 : 7 + SLOTS * SLOT] = entries[::-1].reshape(1, -1)
        np.testing.assert_allclose(
            twin.forward(row, twin.start())[0], twin.forward(swapped, twin.start())[0], atol=1e-5
        )
        hidden[:, 7 + 2 * SLOT] = 0.0
        first = twin.forward(hidden, twin.start())[0]
        hidden[:, 8 + 2 * SLOT : 7 + 3 * SLOT] = 9.0  # what a masked entry holds is not looked at
        assert np.array_equal(first, twin.forward(hidden, twin.start())[0])


def test_the_team_extractor_learns_without_neighbours() -> None:
    made = model("team attention")
    inputs = torch.zeros((3, SIZE))
    made.policy.evaluate_actions(inputs, torch.zeros(3))[1].sum().backward()
    gradients = [weights.grad for weights in made.policy.parameters() if weights.grad is not None]
    assert gradients
    assert all(bool(torch.isfinite(gradient).all()) for gradient in gradients)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"activation_fn": nn.ELU}, "Tanh or ReLU"),
        ({"activation_fn": nn.ReLU, **team("mean")}, "must be the same"),
    ],
)
def test_what_cannot_be_repeated_is_refused_in_one_line(keywords: dict[str, Any], message: str) -> None:
    made = PPO("MlpPolicy", Bare(DISCRETE), policy_kwargs=keywords, device="cpu")
    with pytest.raises(InputError, match=message):
        exported(made)


def test_state_dependent_exploration_is_refused() -> None:
    with pytest.raises(InputError, match="use_sde"):
        exported(PPO("MlpPolicy", Bare(BOX), use_sde=True, device="cpu"))


def test_entries_beyond_the_observation_are_refused() -> None:
    space = spaces.Box(-1.0, 1.0, (10,), np.float32)
    with pytest.raises(InputError, match="beyond the 10 numbers"):
        TeamExtractor(space, {"start": 7, "slots": 3, "slot_size": 6})
