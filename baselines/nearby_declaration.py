"""Declaring a source without a belief: "I have smelt more here than I would a few metres downwind of it".

For searchers that keep no map. The hits of all samples taken within `declare_radius` of the UAV's place are averaged
over their sampling time. If that rate is at least what the told plume gives `declare_radius` straight downwind of a
source, the place is suspect: the searcher stays and samples on. Once `declare_time` of samples agree, it declares its
own place. A sensor that reports concentrations is judged alike, by the mean concentration on the told plume's axis.
The radius is at most 0.6 of the distance within which a declaration is right.
"""

from __future__ import annotations

import math

import numpy as np

from baselines.belief.likelihood import AdvertisedPlume
from baselines.policy import Briefing
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, Parameters, quantity

_MEMORY = 64  # rows of samples
_ROWS = 32  # in `declare_time`, at most: shorter samples, of a sensor at 10 Hz, are added up
_OF_SUCCESS = 0.6  # of the success radius: farther away a declaration of the own place would be too bold


class NearbyParameters(Parameters):
    """Thresholds of `NearbyRule`; mixed into the parameters of policies that declare by it."""

    declare_radius: float = quantity(3.0, "m", gt=0)
    declare_time: float = quantity(8.0, "s", gt=0)  # of sampling near the place


class NearbyRule:
    """The rule for one UAV and episode."""

    __slots__ = (
        "_least",
        "_next",
        "_plume",
        "_radius",
        "_row_time",
        "_samples",
        "_speed",
        "_time",
        "_told",
        "declared",
        "suspects",
    )

    def __init__(self, parameters: NearbyParameters, briefing: Briefing) -> None:
        self._plume = AdvertisedPlume(briefing) if briefing.gas_sensor.reports == "hits" else None
        self._told, self._speed = briefing.plume, 0.0  # m/s
        self._radius = min(parameters.declare_radius, _OF_SUCCESS * briefing.success_radius)
        self._time, self._least = parameters.declare_time, briefing.threshold
        self._row_time = self._time / _ROWS  # s
        self._samples = np.zeros((_MEMORY, 5))  # x, y, z (m), hits or concentration times s, sampling time (s)
        self._next = 0
        self.suspects = False  # the rate near here is that of a source, but not for long enough yet
        self.declared: FloatArray | None = None  # (3,) m

    def threshold(self) -> float:
        """The rate, 1/s, or the concentration of the advertised plume `declare_radius` downwind of a source."""
        if self._plume is None:
            return float(self._told.axis_mean(self._radius, self._speed))
        model = self._plume.model
        distance = max(self._radius, model.clamp_distance)
        exponent = distance * (math.hypot(model.drift_x, model.drift_y) - model.inverse_lambda)
        return model.detection_probability * model.strength / distance * math.exp(exponent) + model.background

    def take(self, observation: Observation) -> None:
        """Take note of the last reading, and judge the place."""
        if self._plume is not None:
            self._plume.measure(observation.wind)
        self._speed = math.hypot(observation.wind[0], observation.wind[1])
        if observation.sampling_time <= 0.0:
            return
        row = self._samples[self._next % _MEMORY]
        weight = 1.0 if self._plume is not None else observation.sampling_time
        if row[4] >= self._row_time:
            self._next += 1
            row = self._samples[self._next % _MEMORY]
            row[3:] = 0.0
        row[:3] = observation.position
        row[3] += observation.reading * weight
        row[4] += observation.sampling_time
        near = np.linalg.norm(self._samples[:, :3] - observation.position, axis=1) <= self._radius
        hits, duration = self._samples[near, 3].sum(), self._samples[near, 4].sum()
        here = observation.reading > self._least or bool(self.suspects)
        enough = duration > 0.0 and hits >= self.threshold() * duration
        self.suspects = bool(enough and here)
        self.declared = observation.position.copy() if self.suspects and duration >= self._time else None
