"""What a training is composed of: the bases of its environments and networks, and the networks that SB3 builds itself.

A new kind of environment or network is a class here or elsewhere, under a name in `training.training_config`. Nothing
here imports torch before a training begins.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from osl_env.errors import InputError
from osl_env.parameters import Parameters, quantity
from osl_env.scenario import Scenario

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

    from baselines.features import FeatureSpec
    from baselines.learned.checkpoint import ObservationDefinition

Activation = Literal["tanh", "relu"]


@dataclass(frozen=True)
class Task:
    """What a checkpoint says about the environment that it was trained in."""

    agent: Literal["hop", "waypoint", "velocity", "setpoint", "course", "search"]
    scenario: Scenario  # the first of those trained in
    max_uavs: int
    observation: ObservationDefinition
    action: dict[str, Any]  # what the network's outputs mean
    features: FeatureSpec = ()


class Environment(Parameters):
    """Base of the environments' parameters."""

    kind: str

    @abstractmethod
    def make(self, seed: int) -> VecEnv:
        """The environment, its episodes' seeds derived from `seed` on. Raises InputError for what cannot be made.

        Its state must be arrays, numbers, texts and containers of these: `training.snapshot` saves it whole. One that
        changes its scenarios as it goes has `state_dict` and `load_state_dict`, which bring back the scenarios.
        """

    @abstractmethod
    def task(self) -> Task:
        """For the checkpoints' headers."""


class Network(Parameters):
    """Base of the networks' parameters."""

    kind: str
    algorithms: ClassVar[tuple[str, ...]]  # the kinds of algorithm that can train it

    @abstractmethod
    def policy(self, task: Task) -> tuple[str | type[Any], dict[str, Any]]:
        """SB3's policy class, or its alias, and its keyword arguments. A policy with a method `exported()` gives
        its architecture and arrays itself; the others are read by `training.networks.exported`.
        """


class MLP(Network):
    """Fully connected layers, apart for policy and value."""

    algorithms: ClassVar[tuple[str, ...]] = ("ppo", "dqn", "sac")
    kind: Literal["mlp"] = "mlp"
    layers: tuple[int, ...] = quantity((64, 64), "", min_length=1, max_length=16)
    activation: Activation = "tanh"
    initial_std: float | None = quantity(None, "", gt=0)  # of PPO's continuous actions; None: 1

    def policy(self, task: Task) -> tuple[str, dict[str, Any]]:
        """SB3's own."""
        keywords = {"net_arch": list(self.layers), "activation_fn": activation_class(self.activation)}
        return "MlpPolicy", keywords | (
            {} if self.initial_std is None else {"log_std_init": math.log(self.initial_std)}
        )


class LSTM(Network):
    """A memory of the episode, then fully connected layers; policy and value have memories of their own.

    With `beside`, the layers get the observation next to the memory, and the value no memory: it trains faster.
    """

    algorithms: ClassVar[tuple[str, ...]] = ("recurrent-ppo",)
    kind: Literal["lstm"] = "lstm"
    memory: int = quantity(64, "", ge=1, le=65536)  # units of an LSTM
    memory_layers: int = quantity(1, "", ge=1, le=8)
    beside: bool = False
    last_logit: float = quantity(0.0, "", ge=-20, le=20)  # with `beside`: initial bias of the action that declares
    layers: tuple[int, ...] = quantity((64,), "", max_length=16)
    activation: Activation = "tanh"

    def policy(self, task: Task) -> tuple[str | type[Any], dict[str, Any]]:
        """sb3-contrib's own, or that of `training.recurrent_policy`."""
        arguments = {
            "lstm_hidden_size": self.memory,
            "n_lstm_layers": self.memory_layers,
            "net_arch": list(self.layers),
            "activation_fn": activation_class(self.activation),
        }
        if not self.beside:
            return "MlpLstmPolicy", arguments
        from training.recurrent_policy import BesideLstmPolicy

        return BesideLstmPolicy, arguments | {"last_logit": self.last_logit}


class Team(Network):
    """Attention or pooling over the teammates' entries (the feature `team`), then fully connected layers."""

    algorithms: ClassVar[tuple[str, ...]] = ("ppo", "dqn", "sac")
    kind: Literal["team"] = "team"
    embedding: int = quantity(64, "", ge=1, le=65536)
    pooling: Literal["attention", "mean", "max"] = "attention"
    layers: tuple[int, ...] = quantity((64, 64), "", min_length=1, max_length=16)
    activation: Activation = "tanh"

    def policy(self, task: Task) -> tuple[str, dict[str, Any]]:
        """SB3's, behind the extractor of `training.networks`. Raises InputError without the feature `team`."""
        from baselines.features import spec_slices
        from training.networks import TeamExtractor

        places = [
            (feature, columns)
            for feature, columns in zip(task.features, spec_slices(task.features), strict=True)
            if feature.kind == "team"
        ]
        if len(places) != 1:
            raise InputError("network.kind = 'team': environment.features must hold {kind: team} once")
        feature, columns = places[0]
        entries = {
            "start": columns.start,
            "slots": feature.slots,
            "slot_size": (columns.stop - columns.start) // feature.slots,
            "embedding": self.embedding,
            "pooling": self.pooling,
        }
        return "MlpPolicy", {
            "features_extractor_class": TeamExtractor,
            "features_extractor_kwargs": {"team": entries, "activation": self.activation},
            "net_arch": list(self.layers),
            "activation_fn": activation_class(self.activation),
        }


def activation_class(name: Activation) -> type[Any]:
    """The torch module of the activation `name`."""
    from torch import nn

    return {"tanh": nn.Tanh, "relu": nn.ReLU}[name]
