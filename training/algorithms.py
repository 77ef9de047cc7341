"""From a training's configuration to the model of Stable-Baselines3 or sb3-contrib that learns it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from gymnasium import spaces
from sb3_contrib import RecurrentPPO
from stable_baselines3 import DQN, PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from osl_env.errors import InputError
from training.training_config import LearningRate, TrainingConfig

_CLASSES: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "recurrent-ppo": RecurrentPPO, "dqn": DQN, "sac": SAC}
_ACTIONS: dict[str, tuple[type[spaces.Space[Any]], str]] = {
    "dqn": (spaces.Discrete, "needs discrete actions (a scenario with action: hop)"),
    "sac": (spaces.Box, "needs continuous actions (a scenario with action: velocity, setpoint or waypoint)"),
}


def make_model(config: TrainingConfig, env: VecEnv) -> BaseAlgorithm:
    """The untrained model for `env`, all generators seeded, episodes from the training's own seeds.

    Raises InputError if algorithm, network and environment do not go together.
    """
    _check(config, env)
    torch.set_num_threads(config.threads)
    algorithm = config.algorithm
    policy, policy_arguments = config.network.policy(config.environment.task())
    arguments = algorithm.model_dump(exclude={"kind", "learning_rate", "final_learning_rate"})
    model = _CLASSES[algorithm.kind](
        policy,
        env,
        learning_rate=learning_rate(algorithm),
        policy_kwargs=policy_arguments,
        seed=config.seed,
        device=_device(config.device),
        **arguments,
    )
    env.seed(config.first_episode_seed)  # SB3 has just given it the seed of the weights
    return model


def learning_rate(rate: LearningRate) -> float | Callable[[float], float]:
    """SB3's schedule: of the remaining part of the training, 1 to 0."""
    first, last = rate.learning_rate, rate.final_learning_rate
    if last is None:
        return first
    return lambda remaining: last + (first - last) * max(remaining, 0.0)


def _device(name: str) -> str:
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("device = 'cuda': torch finds no CUDA device here; allowed are cpu, auto")
    return name


def _check(config: TrainingConfig, env: VecEnv) -> None:
    algorithm, network = config.algorithm, config.network
    if algorithm.kind not in network.algorithms:
        raise InputError(
            f"network.kind = {network.kind!r}: is trained by {' or '.join(network.algorithms)},"
            f" not by algorithm.kind = {algorithm.kind!r}"
        )
    if algorithm.kind in _ACTIONS:
        space, needs = _ACTIONS[algorithm.kind]
        if not isinstance(env.action_space, space):
            raise InputError(f"algorithm.kind = {algorithm.kind!r}: {needs}")
    if algorithm.kind == "ppo":
        rollout = algorithm.n_steps * env.num_envs
        if rollout % algorithm.batch_size:
            raise InputError(
                f"algorithm.batch_size = {algorithm.batch_size}: must divide the rollout, n_steps * slots ="
                f" {algorithm.n_steps} * {env.num_envs} = {rollout}"
            )
