"""A policy of your own: a class with two methods, scored on the same seeds as the others.

    python examples/own_policy.py --steps 40

`Rally` searches at random until somebody smells something, and then surges upwind from the place of the team's latest
detection. Every UAV's frame carries position and reading anyway; its payload adds when and where it last smelt gas, so
that a UAV which was out of range at that moment still learns of it.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
import tyro
from pydantic import PrivateAttr

import osl_env
from baselines import Briefing, Policy, register_policy
from baselines.nearby_declaration import NearbyParameters, NearbyRule
from osl_env.actions import Action, Hover, Waypoint
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message
from training import evaluate

_PAYLOAD = struct.Struct("<4f")  # time, s, and place, m, of the sender's latest detection: 16 bytes, paid for


@register_policy
class Rally(NearbyParameters, Policy):
    """Surge upwind from the team's latest detection; random legs until there is one."""

    name: ClassVar[str] = "rally"
    summary: ClassVar[str] = "surge upwind from the team's latest detection"

    surge: float = quantity(4.0, "m", gt=0)  # upwind of the detection; a parameter, with unit and limits
    scatter: float = quantity(4.0, "m", ge=0)  # standard deviation of where a UAV goes
    leg: float = quantity(5.0, "m", gt=0)  # between samples while nothing has been smelt
    patience: float = quantity(300.0, "s", gt=0)  # a detection older than this is forgotten

    # an episode's state, set by `reset`
    _rng: np.random.Generator = PrivateAttr()
    _area: FloatArray = PrivateAttr()  # (3,) m
    _goal: FloatArray = PrivateAttr()  # (3,) m, of the random search
    _rule: NearbyRule = PrivateAttr()  # when to declare
    _latest: tuple[float, FloatArray] | None = PrivateAttr(default=None)  # s, (3,) m: the team's latest detection

    def reset(self, briefing: Briefing) -> None:
        """All that is known before take-off is in `briefing`; random draws come from its seed."""
        self._rng = np.random.default_rng(briefing.seed)
        self._area, self._goal = briefing.area, briefing.start
        self._rule, self._latest = NearbyRule(self, briefing), None

    def broadcast(self, observation: Observation) -> bytes | None:
        """What this UAV's frame carries besides position and reading."""
        if observation.reading > 0:
            self._latest = (observation.time, observation.position.copy())
        return None if self._latest is None else _PAYLOAD.pack(self._latest[0], *self._latest[1])

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next leg."""
        for message in inbox:
            if message.payload:
                when, *place = _PAYLOAD.unpack(message.payload)
                if self._latest is None or when > self._latest[0]:
                    self._latest = (when, np.array(place))
        self._rule.take(observation)
        if self._rule.suspects:  # as strong as beside a source: stay and make sure
            return Hover()
        if self._latest is None or observation.time - self._latest[0] > self.patience:
            return self._search(observation.position)
        upwind = -observation.wind / max(float(np.linalg.norm(observation.wind)), 1e-9)
        target = self._latest[1] + self.surge * upwind + self._rng.normal(0.0, self.scatter, 3)
        return Waypoint(np.clip(target, 0.0, self._area))

    def _search(self, position: FloatArray) -> Waypoint:
        """A leg towards a random place, and on to another from there."""
        distance = float(np.linalg.norm(self._goal - position))
        if distance < self.leg:
            self._goal = self._rng.uniform(0.0, self._area)
            distance = float(np.linalg.norm(self._goal - position))
        return Waypoint(position + (self._goal - position) * min(1.0, self.leg / distance))

    def declaration(self) -> FloatArray | None:
        """(3,) m, the place where the source is said to be; None as long as the search goes on."""
        return self._rule.declared


def main(steps: int = 40, scenario: str = "rate-60x60x30-random") -> None:
    """Fly `steps` episodes of each policy and print success rate and capped mean search time with 95 % intervals."""
    for name in (Rally.name, "surge-cast", "random-walk"):
        # one process: a class that is defined in a script is not known to others (a module's is)
        records = evaluate(name, osl_env.load_scenario(scenario), seeds=range(steps), n_jobs=1)
        rate, time = records.estimate("success_rate"), records.estimate("capped_search_time")
        print(
            f"{name:12} success rate {100 * rate.value:3.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}],"
            f" capped mean search time {time.value / 60:4.1f} min [{time.low / 60:.1f}, {time.high / 60:.1f}]"
        )


if __name__ == "__main__":
    tyro.cli(main)
