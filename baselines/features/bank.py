"""FeatureBank: the features of all UAVs of a batch of worlds. SoloFeatures: the same kernels for one UAV in flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.features.belief import BeliefBank
from baselines.features.hits import HitHistory
from baselines.features.readings import Readings, heard_rows
from baselines.features.rows import FlatRow, write_team
from baselines.features.spec import (
    NEIGHBOUR_SIZE,
    OWN_SIZE,
    BeliefFeatures,
    FeatureSpec,
    HitsFeatures,
    RawFeatures,
    TeamFeatures,
    spec_size,
    spec_slices,
)
from baselines.policy import Briefing
from osl_env.observation import Observation, ObservationLayout
from osl_env.parameters import FloatArray
from osl_env.radio import Message
from osl_env.scenario import Scenario
from osl_env.state import EPISODE, MOTION, SENSES, BoolArray, StateArray
from osl_env.world import World

Float32Array = NDArray[np.float32]


class _Memory(Protocol):
    """A feature that remembers what was read."""

    def reset(self, mask: BoolArray) -> None: ...

    def update(
        self, motion: StateArray, senses: StateArray, episode: StateArray, mask: BoolArray, out: Float32Array,
        start: int,
    ) -> None: ...  # fmt: skip


def _source(feature: HitsFeatures | BeliefFeatures) -> str:
    return "own" if isinstance(feature, HitsFeatures) and not feature.heard else "heard"


class _Features:
    """What a bank and a lone UAV share: features in order, and how their numbers are written."""

    def __init__(
        self, spec: FeatureSpec, area: FloatArray, plume: Any, gas_sensor: Any, success_radius: float,
        readings: dict[str, Any],
    ) -> None:  # fmt: skip
        self.spec, self.size = spec, spec_size(spec)
        self._slices, self._side = spec_slices(spec), np.float32(np.max(area))
        self._memories: list[_Memory | None] = []
        for feature in spec:
            if isinstance(feature, HitsFeatures):
                self._memories.append(HitHistory(feature, area, readings[_source(feature)]))
            elif isinstance(feature, BeliefFeatures):
                self._memories.append(
                    BeliefBank(feature, area, plume, gas_sensor, success_radius, readings[_source(feature)])
                )
            else:
                self._memories.append(None)

    def forget(self, mask: BoolArray) -> None:
        """Reset the memories in the worlds of `mask`."""
        for memory in self._memories:
            if memory is not None:
                memory.reset(mask)

    def write(
        self, state: tuple[StateArray, StateArray, StateArray], flat: Float32Array, mask: BoolArray, out: Float32Array
    ) -> None:
        """All features' numbers into `out` (n_worlds, n_uavs, size), in the worlds of `mask`."""
        for feature, memory, columns in zip(self.spec, self._memories, self._slices, strict=True):
            start = columns.start
            if memory is not None:
                memory.update(*state, mask, out, start)
            elif isinstance(feature, TeamFeatures):
                write_team(flat, self._side, feature.slots, mask, out, start)
            elif isinstance(feature, RawFeatures):
                width = min(flat.shape[2], OWN_SIZE + NEIGHBOUR_SIZE * feature.neighbours)
                chosen: BoolArray | slice = slice(None) if mask.all() else mask
                out[chosen, :, start : start + width] = flat[chosen, :, :width]
                out[chosen, :, start + width : columns.stop] = 0.0


class FeatureBank:
    """The observations of every UAV of `n_worlds` worlds of `scenario`."""

    def __init__(self, spec: FeatureSpec, scenario: Scenario, n_worlds: int) -> None:
        """Allocate the state; `reset` comes before the first `update`. Raises InputError if a plume has no hits."""
        self._shape = (n_worlds, scenario.team.n_uavs)
        self._readings = {
            source: Readings(scenario, n_worlds, source)
            for source in ("own", "heard")
            if any(_source(f) == source for f in spec if isinstance(f, HitsFeatures | BeliefFeatures))
        }
        self._features = _Features(
            spec, np.array(scenario.arena.size), scenario.advertised_plume or scenario.plume, scenario.gas_sensor,
            scenario.ending.success_radius, self._readings,
        )  # fmt: skip
        self.spec, self.size = spec, self._features.size
        self._layout = ObservationLayout(scenario)
        self._flat = np.zeros((*self._shape, self._layout.flat_size), dtype=np.float32)
        self._all: BoolArray = np.ones(n_worlds, np.bool_)

    def reset(self, mask: BoolArray | None = None) -> None:
        """Forget the episodes of the worlds in `mask` (n_worlds,) bool; of all without a mask."""
        chosen = self._all if mask is None else mask
        for readings in self._readings.values():
            readings.reset(chosen)
        self._features.forget(chosen)

    def update(self, world: World, mask: BoolArray | None = None, out: Float32Array | None = None) -> Float32Array:
        """The observations (n_worlds, n_uavs, size) float32 now, into `out` if given.

        Once after each reset and each step: every call takes in what the UAVs read and heard. With a `mask`
        (n_worlds,) bool only those worlds' readings are taken in, and only their rows are written.
        """
        chosen = self._all if mask is None else mask
        rows = np.empty((*self._shape, self.size), dtype=np.float32) if out is None else out
        for readings in self._readings.values():
            readings.gather(world, chosen)
        flat = self._layout.flat(world, self._flat)[..., : self._layout.flat_size - self._layout.n_rays]
        self._features.write((world.motion, world.senses, world.episode), flat, chosen, rows)
        return rows


class SoloFeatures:
    """The observations of one UAV in flight: the same numbers as in a FeatureBank, from what its policy is given."""

    def __init__(self, spec: FeatureSpec, briefing: Briefing) -> None:
        """Ready for the first decision of the episode. Raises InputError if the plume has no hits."""
        self._uav = briefing.uav
        self._readings = {source: _OneListener() for source in ("own", "heard")}
        self._features = _Features(
            spec, briefing.area, briefing.plume, briefing.gas_sensor, briefing.success_radius, self._readings
        )
        self.spec, self.size = spec, self._features.size
        self._row = FlatRow(
            briefing.area, briefing.speed, briefing.energy_capacity, briefing.time_limit, briefing.gas_sensor.scale
        )
        self._motion: StateArray = np.zeros((1, 1), MOTION)
        self._senses: StateArray = np.zeros((1, 1), SENSES)
        self._episode: StateArray = np.zeros(1, EPISODE)
        self._motion["active"] = self._motion["ready"] = True
        self._all: BoolArray = np.ones(1, np.bool_)
        self._features.forget(self._all)

    def update(self, observation: Observation, inbox: Sequence[Message]) -> Float32Array:
        """The observation (size,) float32 at a decision, with the frames that have come since the last one."""
        self._motion["position"] = observation.position
        self._senses["wind"] = observation.wind
        self._episode["clock"] = observation.time
        self._readings["own"].take(heard_rows(observation, (), self._uav))
        self._readings["heard"].take(heard_rows(observation, inbox, self._uav))
        out = np.empty((1, 1, self.size), dtype=np.float32)
        flat = self._row.flat(observation)[None, None]
        self._features.write((self._motion, self._senses, self._episode), flat, self._all, out)
        row: Float32Array = out[0, 0]
        return row


class _OneListener:
    """Readings of a batch of one."""

    def __init__(self) -> None:
        self.rows = np.zeros((1, 1, 1, 6))
        self.count = np.zeros((1, 1), np.int64)

    def take(self, rows: FloatArray) -> None:
        """`rows` (F, 6) are what is new."""
        self.rows = np.ascontiguousarray(rows)[None, None]
        self.count[0, 0] = len(rows)
