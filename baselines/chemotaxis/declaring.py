"""Declaring the source by `NearbyRule`, from samples of any length.

The rule remembers a number of samples, whatever their length: at 20 Hz that would be three seconds, less than its
`declare_time`. So samples are put together into lots of an eighth of that time, with their mean place and reading.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.policy import Briefing
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

_LOTS = 8  # in the declare_time


class Declaring:
    """The rule for one UAV and episode."""

    __slots__ = ("_counts", "_lot", "_over", "_rule", "_sums")

    def __init__(self, parameters: NearbyParameters, briefing: Briefing) -> None:
        self._rule = NearbyRule(parameters, briefing)
        self._counts = briefing.gas_sensor.reports == "hits"
        self._lot = parameters.declare_time / _LOTS * (1.0 - 1e-9)  # s
        self._sums = [0.0] * 5  # of sampling time (s), and of x, y, z (m) and concentration times it
        self._over = False  # it has declared and the search goes on: nobody asks for declarations here

    @property
    def suspects(self) -> bool:
        """Whether the UAV should stay where it is, to make sure."""
        return self._rule.suspects and not self._over

    @property
    def declared(self) -> FloatArray | None:
        """(3,) m, once the rule holds."""
        return None if self._over else self._rule.declared

    def take(self, observation: Observation, position: tuple[float, float, float], concentration: float) -> None:
        """Take note of a sample at `position`, m; `concentration` is hits a second for a sensor that counts."""
        self._over = self._over or self._rule.declared is not None
        if self._over:
            return
        duration, sums = observation.sampling_time, self._sums
        sums[0] += duration
        sums[1] += duration * position[0]
        sums[2] += duration * position[1]
        sums[3] += duration * position[2]
        sums[4] += duration * concentration
        if sums[0] < self._lot:
            return
        time, self._sums = sums[0], [0.0] * 5
        reading = sums[4] if self._counts else sums[4] / time
        place = np.array(sums[1:4]) / time
        self._rule.take(dataclasses.replace(observation, position=place, reading=reading, sampling_time=time))
