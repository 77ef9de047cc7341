"""When a UAV's budget is about to end: the last decision at which it can still declare.

GaSLAM declares at the end of its time budget. A UAV that is out of time, of energy or of decisions can say nothing any
more, so it declares when what is left would not do for `_RESERVE` decisions like the longest, or the most costly, that
it has taken so far or is about to take.
"""

from __future__ import annotations

from baselines.policy import Briefing
from osl_env.observation import Observation

_RESERVE = 2.0


class Budget:
    """The budget of one UAV and episode."""

    __slots__ = ("_energy", "_left", "_longest", "_max_decisions", "_most")

    def __init__(self, briefing: Briefing) -> None:
        self._max_decisions = briefing.max_decisions
        self._left, self._energy = briefing.time_limit, briefing.energy_capacity  # s, J: at the last decision
        self._longest = briefing.decision_period if briefing.action != "leg" else 0.0  # s, of a decision
        self._most = 0.0  # J, of a decision

    def take(self, observation: Observation) -> None:
        """Take note of what the last decision has cost."""
        self._longest = max(self._longest, self._left - observation.time_left)
        self._most = max(self._most, self._energy - observation.energy_left)
        self._left, self._energy = observation.time_left, observation.energy_left

    def ends(self, observation: Observation, duration: float = 0.0) -> bool:
        """Whether to declare now rather than take a decision of `duration` s."""
        return (
            observation.time_left <= _RESERVE * max(self._longest, duration)
            or observation.energy_left <= _RESERVE * self._most
            or observation.decision >= self._max_decisions - 1
        )
