"""sb3-contrib's recurrent policy, trained faster: the policy's memory beside the observation, one pass a sequence.

The hidden layers get the memory and, next to it, the features themselves, so that reacting to what is observed now
need not be learned through the memory's gates; the value depends on the features alone. Sequences that begin an episode
go through the LSTM in one call, from zero states, instead of step by step.
"""

from __future__ import annotations

from typing import Any

import torch
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from stable_baselines3.common.torch_layers import MlpExtractor
from torch import nn

States = tuple[torch.Tensor, torch.Tensor]


class _Beside(nn.Module):
    """What the value's layers get in place of a memory: an embedding of the features, and the features."""

    def __init__(self, n_features: int, size: int) -> None:
        super().__init__()
        self.embedding = nn.Linear(n_features, size)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        return torch.cat([torch.tanh(self.embedding(features)), features], dim=1)


class BesideLstmPolicy(RecurrentActorCriticPolicy):
    """A memory beside the observation."""

    def __init__(self, *arguments: Any, last_logit: float = 0.0, **keywords: Any) -> None:
        """`last_logit`: initial bias of the last of discrete actions, which declares. The rest is sb3-contrib's."""
        super().__init__(*arguments, **{**keywords, "enable_critic_lstm": False})
        critic: Any = _Beside(self.features_dim, self.lstm_output_dim)
        self.critic = critic
        last_layer: Any = self.action_net
        with torch.no_grad():
            last_layer.bias[-1] += last_logit
        # again, as it must hold the new layer's weights too
        optimizer: Any = self.optimizer_class
        rate = self.optimizer.param_groups[0]["lr"]
        self.optimizer = optimizer(self.parameters(), lr=rate, **self.optimizer_kwargs)

    def _build_mlp_extractor(self) -> None:
        width = self.lstm_output_dim + self.features_dim
        self.mlp_extractor = MlpExtractor(
            width, net_arch=self.net_arch, activation_fn=self.activation_fn, device=self.device
        )

    @staticmethod
    def _process_sequence(
        features: torch.Tensor, lstm_states: States, episode_starts: torch.Tensor, lstm: nn.LSTM
    ) -> tuple[torch.Tensor, Any]:
        """(n, memory + features) for `features` (n, features), and the states after each sequence."""
        starts = episode_starts.reshape(lstm_states[0].shape[1], -1)
        if bool((starts[:, 1:] == 0.0).all()):  # episodes begin with sequences, if at all
            kept = (1.0 - starts[:, 0])[None, :, None]
            lstm_states = lstm_states[0] * kept, lstm_states[1] * kept
            episode_starts = torch.zeros_like(episode_starts)
        memory, states = RecurrentActorCriticPolicy._process_sequence(features, lstm_states, episode_starts, lstm)
        return torch.cat([memory, features], dim=1), states
