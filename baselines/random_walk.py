"""Random walk: the floor of every comparison. Seeded hops in the area, a direction kept for a random number of hops.

It stops where it smells as much as beside a source, to make sure, and declares by `baselines.nearby_declaration`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import PrivateAttr

from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.passage import Passage
from baselines.policy import Briefing, Policy, register_policy
from osl_env.actions import HOP_DIRECTIONS, Action, Hop, Hover
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message


class Walk:
    """One UAV's state of an episode."""

    __slots__ = ("_area", "_direction", "_generator", "_hop", "_length", "_passage", "_persistence", "rule")

    def __init__(self, parameters: RandomWalk, briefing: Briefing) -> None:
        self.rule = NearbyRule(parameters, briefing)
        self._generator = np.random.default_rng(briefing.seed)
        self._persistence, self._area = parameters.persistence, np.asarray(briefing.area, dtype=np.float64)
        self._length = min(parameters.hop_length, briefing.hop_lengths)
        self._hop = self._length * briefing.step_length
        self._direction = -1
        self._passage = Passage(briefing)

    def act(self, observation: Observation) -> Action:
        """Hover in a suspect place; else go on, or turn."""
        self.rule.take(observation)
        ends = observation.position + self._hop * HOP_DIRECTIONS
        clear = self._passage.reach(observation.position, self._hop)[:-1] > 0
        inside = np.flatnonzero(np.all((ends >= 0.0) & (ends <= self._area), axis=1) & clear)
        turns = self._generator.random() >= self._persistence
        choice = int(self._generator.integers(max(len(inside), 1)))
        if self.rule.suspects or len(inside) == 0:
            return Hover()
        if turns or self._direction not in inside:
            self._direction = int(inside[choice])
        return Hop(self._direction, self._length)


@register_policy
class RandomWalk(NearbyParameters, Policy):
    """Seeded random walk on the 26 neighbours of a 3D grid."""

    name: ClassVar[str] = "random-walk"
    summary: ClassVar[str] = "seeded random hops; declares where it smells as much as beside a source"
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    hop_length: int = quantity(3, "", ge=1)  # grid steps; not more than the scenario's longest
    persistence: float = quantity(0.8, "", ge=0, lt=1)  # probability of keeping the direction at a hop

    _walk: Walk | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._walk = Walk(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next hop; nothing is heard."""
        if self._walk is None:
            raise RuntimeError("random-walk: reset(briefing) comes before the first decision")
        return self._walk.act(observation)

    def declaration(self) -> FloatArray | None:
        """(3,) m, the UAV's own place, once the rule holds."""
        return self._walk.rule.declared if self._walk else None
