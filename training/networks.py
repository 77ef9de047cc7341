"""The torch side of learned policies: the team extractor, and the export of SB3 models to plain arrays.

`exported` takes a PPO, RecurrentPPO, DQN or SAC model with SB3's default policy for vectors (`MlpPolicy`,
`MlpLstmPolicy`), with or without `TeamExtractor`, and gives what `baselines.learned.network.Network` flies.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, FlattenExtractor
from torch import nn

from baselines.learned.dense import Float32Array
from baselines.learned.network import Architecture, TeamSizes
from osl_env.errors import InputError

_ACTIVATIONS: dict[type[nn.Module], str] = {nn.Tanh: "tanh", nn.ReLU: "relu"}
ACTIVATIONS: dict[str, type[nn.Module]] = {name: module for module, name in _ACTIVATIONS.items()}
ALGORITHMS = ("PPO", "RecurrentPPO", "DQN", "SAC")
Arrays = dict[str, Float32Array]


class TeamExtractor(BaseFeaturesExtractor):
    """One policy for any number of UAVs: attention or pooling over the masked entries of the neighbours.

    `team` (or its fields as a mapping) says where the entries stand (see `TeamSizes`). Features out: the UAV's own
    embedding and the neighbours' pooled one, 2 `embedding` numbers; the latter is 0 where there is no neighbour.
    """

    def __init__(
        self,
        observation_space: spaces.Box,
        team: TeamSizes | dict[str, Any],
        activation: Literal["tanh", "relu"] = "tanh",
    ) -> None:
        """Raises InputError if the entries end beyond the observation."""
        sizes = team if isinstance(team, TeamSizes) else TeamSizes(**team)
        super().__init__(observation_space, features_dim=2 * sizes.embedding)
        inputs, end = observation_space.shape[0], sizes.start + sizes.slots * sizes.slot_size
        if end > inputs:
            raise InputError(f"team: its entries end at {end}, beyond the {inputs} numbers of the observation")
        self.sizes, self.end = sizes, end
        self.activation = ACTIVATIONS[activation]()
        size = sizes.embedding
        self.own = nn.Linear(inputs - sizes.slots * sizes.slot_size, size)
        self.entry = nn.Linear(sizes.slot_size - 1, size)
        if sizes.pooling == "attention":
            self.query, self.key, self.value = (nn.Linear(size, size, bias=False) for _ in range(3))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """(n, 2 embedding) for `observations` (n, inputs)."""
        sizes = self.sizes
        slots = observations[:, sizes.start : self.end].reshape(-1, sizes.slots, sizes.slot_size)
        own = torch.cat([observations[:, : sizes.start], observations[:, self.end :]], dim=1)
        own = self.activation(self.own(own))
        present = slots[..., 0] > 0.5
        entries = self.activation(self.entry(slots[..., 1:]))
        return torch.cat([own, self._pooled(own, entries, present)], dim=1)

    def _pooled(self, own: torch.Tensor, entries: torch.Tensor, present: torch.Tensor) -> torch.Tensor:
        """(n, embedding) of `entries` (n, slots, embedding) where `present` (n, slots)."""
        mask = present.unsqueeze(-1)
        if self.sizes.pooling == "mean":
            mean: torch.Tensor = (entries * mask).sum(dim=1) / mask.sum(dim=1).clamp(min=1)
            return mean
        if self.sizes.pooling == "max":
            lowest = torch.finfo(entries.dtype).min
            return entries.masked_fill(~mask, lowest).max(dim=1).values * present.any(dim=1, keepdim=True)
        products = (self.key(entries) @ self.query(own).unsqueeze(-1)).squeeze(-1) / self.sizes.embedding**0.5
        # finite where masked, so that a row without neighbours has gradients without NaN
        shares = torch.softmax(products.masked_fill(~present, -1e9), dim=1) * present
        attended: torch.Tensor = (shares.unsqueeze(-1) * self.value(entries)).sum(dim=1)
        return attended


def exported(model: Any) -> tuple[dict[str, Any], Arrays]:
    """The architecture and the float32 arrays (torch's shapes) of the actor of an SB3 `model`.

    Raises InputError for a model whose network the numpy forward pass cannot repeat.
    """
    algorithm = type(model).__name__
    policy = model.policy
    if not isinstance(model.observation_space, spaces.Box) or len(model.observation_space.shape) != 1:
        raise InputError(f"{algorithm}: observations must be vectors, not {model.observation_space}")
    if getattr(model, "use_sde", False):
        raise InputError(f"{algorithm}: state-dependent exploration (use_sde) cannot be exported")
    if hasattr(policy, "q_net"):
        content, arrays = _q_network(policy)
    elif hasattr(policy, "actor"):
        content, arrays = _squashed_actor(policy.actor)
    elif hasattr(policy, "mlp_extractor"):
        content, arrays = _actor_critic(policy)
    else:
        raise InputError(f"{algorithm}: cannot be exported: must be one of {', '.join(ALGORITHMS)}")
    content["inputs"] = int(model.observation_space.shape[0])
    architecture = Architecture.parse(content, algorithm)
    return architecture.model_dump(mode="json", exclude_none=True), arrays


def _actor_critic(policy: Any) -> tuple[dict[str, Any], Arrays]:
    """PPO and RecurrentPPO."""
    content, arrays = _extractor(policy.pi_features_extractor)
    if hasattr(policy, "lstm_actor"):
        content["lstm"], layers = _lstm(policy.lstm_actor)
        arrays |= layers
        content["lstm"]["beside"] = policy.mlp_extractor.policy_net[0].in_features > policy.lstm_actor.hidden_size
        content["kind"] = "team" if "team" in content else "lstm"
    hidden, activation, layers = _hidden(policy.mlp_extractor.policy_net)
    arrays |= layers | _linear("action", policy.action_net)
    discrete = isinstance(policy.action_space, spaces.Discrete)
    if not discrete:
        arrays["log_std"] = _array(policy.log_std)
    head = "logits" if discrete else "gaussian"
    return _complete(content, hidden, activation, policy.action_net, head), arrays


def _q_network(policy: Any) -> tuple[dict[str, Any], Arrays]:
    """DQN."""
    content, arrays = _extractor(policy.q_net.features_extractor)
    *layers, last = policy.q_net.q_net
    hidden, activation, weights = _hidden(layers)
    return _complete(content, hidden, activation, last, "values"), arrays | weights | _linear("action", last)


def _squashed_actor(actor: Any) -> tuple[dict[str, Any], Arrays]:
    """SAC."""
    if not isinstance(getattr(actor, "log_std", None), nn.Linear):
        raise InputError(f"an actor of the type {type(actor).__name__} cannot be exported")
    content, arrays = _extractor(actor.features_extractor)
    hidden, activation, layers = _hidden(actor.latent_pi)
    arrays |= layers | _linear("action", actor.mu) | _linear("log_std", actor.log_std)
    return _complete(content, hidden, activation, actor.mu, "squashed"), arrays


def _complete(
    content: dict[str, Any], hidden: list[int], activation: str, last: nn.Linear, head: str
) -> dict[str, Any]:
    # the extractor has activations of its own; without hidden layers its word counts
    extractor = content.pop("extractor_activation", None)
    if hidden and extractor and extractor != activation:
        raise InputError(f"the extractor's activation {extractor} and the hidden layers' {activation} must be the same")
    content["hidden"], content["activation"] = hidden, activation if hidden or not extractor else extractor
    content["outputs"], content["head"] = last.out_features, head
    return content


def _extractor(extractor: nn.Module) -> tuple[dict[str, Any], Arrays]:
    if isinstance(extractor, FlattenExtractor):
        return {"kind": "mlp"}, {}
    if not isinstance(extractor, TeamExtractor):
        raise InputError(f"a features extractor of the type {type(extractor).__name__} cannot be exported")
    arrays: Arrays = {}
    for name in ("own", "entry", "query", "key", "value"):
        if isinstance(layer := getattr(extractor, name, None), nn.Linear):
            arrays |= _linear(f"team.{name}", layer)
    team = extractor.sizes.model_dump(mode="json")
    return {"kind": "team", "team": team, "extractor_activation": _ACTIVATIONS[type(extractor.activation)]}, arrays


def _lstm(lstm: nn.LSTM) -> tuple[dict[str, Any], Arrays]:
    if lstm.bidirectional or lstm.proj_size or not lstm.bias:
        raise InputError("an LSTM that is bidirectional, projected or without bias cannot be exported")
    arrays: Arrays = {}
    for layer in range(lstm.num_layers):
        arrays[f"lstm.{layer}.input.weight"] = _array(getattr(lstm, f"weight_ih_l{layer}"))
        arrays[f"lstm.{layer}.hidden.weight"] = _array(getattr(lstm, f"weight_hh_l{layer}"))
        # torch adds two biases that always come together
        biases = getattr(lstm, f"bias_ih_l{layer}") + getattr(lstm, f"bias_hh_l{layer}")
        arrays[f"lstm.{layer}.input.bias"] = _array(biases)
    return {"size": lstm.hidden_size, "layers": lstm.num_layers}, arrays


def _hidden(layers: Any) -> tuple[list[int], str, Arrays]:
    """Sizes, activation and weights of a sequence of linear layers, each with the same activation behind it."""
    modules = list(layers)
    linear, activations = modules[0::2], {type(module) for module in modules[1::2]} or {nn.Tanh}
    regular = len(activations) == 1 and all(isinstance(module, nn.Linear) for module in linear)
    if not regular or len(modules) % 2 or not activations <= set(_ACTIVATIONS):
        names = ", ".join(type(module).__name__ for module in modules)
        raise InputError(f"hidden layers ({names}) cannot be exported: must be Linear and Tanh or ReLU in turn")
    arrays: Arrays = {}
    for number, layer in enumerate(linear):
        arrays |= _linear(f"hidden.{number}", layer)
    return [layer.out_features for layer in linear], _ACTIVATIONS[activations.pop()], arrays


def _linear(name: str, layer: nn.Linear) -> Arrays:
    arrays = {f"{name}.weight": _array(layer.weight)}
    if layer.bias is not None:
        arrays[f"{name}.bias"] = _array(layer.bias)
    return arrays


def _array(tensor: torch.Tensor) -> Float32Array:
    return np.array(tensor.detach().cpu().numpy(), dtype=np.float32)
