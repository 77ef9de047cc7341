"""A policy for tests of the runner: flies to random places, tells what it heard, and declares after a while."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines import Briefing, Policy, register_policy
from osl_env.actions import Action, Hop, Hover, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message


@register_policy
class Guesser(Policy):
    """Draws from its own stream only; its legs depend on what the radio brought, so that any mix-up shows."""

    name = "guesser"
    summary = "for tests"

    patience: int = quantity(12, "", ge=1)  # decisions before it declares the best place so far
    payload: int = quantity(8, "", ge=0)  # bytes
    spread: float = quantity(5.0, "m", gt=0)

    _rng: Any = None
    _briefing: Any = None
    _best: Any = None

    def reset(self, briefing: Briefing) -> None:
        self._rng = np.random.default_rng(briefing.seed)
        self._briefing = briefing
        self._best = (-1.0, np.array(briefing.start), 0)

    def broadcast(self, observation: Observation) -> bytes | None:
        return bytes(self.payload) if observation.decision % 2 else None

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        count = self._best[2] + 1
        reading, place = max(
            [(self._best[0], self._best[1]), (observation.reading, observation.position.copy())]
            + [(message.reading, message.position) for message in inbox],
            key=lambda pair: pair[0],
        )
        self._best = (reading, place, count)
        choice = int(self._rng.integers(3))
        if choice == 0:
            return Hop(int(self._rng.integers(26)), 1)
        if choice == 1:
            return Hover(int(self._rng.integers(1, 4)))
        return Waypoint(self._rng.normal(place, self.spread), 1)

    def declaration(self) -> FloatArray | None:
        if self._best[2] < self.patience * (1 + self._briefing.uav):
            return None
        declared: FloatArray = self._best[1]
        return declared
