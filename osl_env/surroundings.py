"""What surrounds the UAVs of a batch of worlds: the wind, the plume, and what sensors perceive of them on the way.

Air and plume go on in ticks, at absolute multiples of the tick on each world's clock, however long the UAVs' legs are:
what they do depends on the scenario and the seed alone (and on the UAVs only where rotors stir the plume). At each
tick the UAVs are taken to be where their legs have brought them (at constant speed along a leg), and a concentration
sensor smells there. Nothing of this is done for a steady plume in a steady wind with a counting sensor.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

from osl_env.air import local_winds, winds_at
from osl_env.geometry import range_readings
from osl_env.parameters import FloatArray
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.sensors import SNIFFER, GasSensor, add_range_noise, begin_range_streams, begin_sniffers, fault_table, sniff
from osl_env.state import BoolArray, IntArray, StateArray
from osl_env.winds.base import Wind

if TYPE_CHECKING:
    from osl_env.scenario import Scenario

_SAME_TIME = 1e-6  # s: a clock is a sum of many rounded periods
_FAR = 1e9  # m: where a UAV is that does not fly


@njit(cache=True, error_model="numpy")
def _next_ticks(
    stepping: BoolArray, until: FloatArray, tick: float, ticks: IntArray, due: BoolArray, times: FloatArray
) -> bool:
    """Which worlds of `stepping` have a tick left before the time `until` (n_envs,), s; counts it. False: none."""
    some = False
    for e in range(ticks.size):
        due[e] = stepping[e] and (ticks[e] + 1) * tick <= until[e] + _SAME_TIME
        if due[e]:
            ticks[e] += 1
            some = True
        times[e] = ticks[e] * tick
    return some


@njit(error_model="numpy")
def _along(m: Any, begin: float, duration: float, time: float, place: Any) -> None:
    """Where UAV `m` is at `time`, if its way from its origin to its target (m) takes `duration` s from `begin` on."""
    share = 1.0
    if duration > 0.0:
        share = min(max((time - begin) / duration, 0.0), 1.0)
    for axis in range(3):
        place[axis] = m.origin[axis] + share * (m.target[axis] - m.origin[axis])


@njit(cache=True, error_model="numpy")
def _whereabouts(
    motion: StateArray,
    clocks: FloatArray,
    due: BoolArray,
    times: FloatArray,
    tick: float,
    sensor_period: float,
    decision_period: float,
    places: FloatArray,
    gives: BoolArray,
    sampling: BoolArray,
) -> None:
    """Where the UAVs are at `times` (n_envs,), s, whether sensors give an output then (n_envs,), and whether it counts.

    `decision_period` is 0 for legs: outputs count while a UAV hovers at the end of its leg; else in all the period.
    """
    for e in range(motion.shape[0]):
        if not due[e]:
            continue
        gives[e] = sensor_period <= tick or math.floor((times[e] + _SAME_TIME) / sensor_period) > math.floor(
            (times[e] - tick + _SAME_TIME) / sensor_period
        )
        for i in range(motion.shape[1]):
            m = motion[e, i]
            sampling[e, i] = m.active
            if not m.active:
                places[e, i, :] = _FAR
            elif decision_period > 0.0:
                share = min(max(1.0 - (clocks[e] - times[e]) / decision_period, 0.0), 1.0)
                for axis in range(3):
                    places[e, i, axis] = m.origin[axis] + share * (m.position[axis] - m.origin[axis])
            else:
                hover = m.leg_end - m.leg_hover
                _along(m, hover - m.leg_flight, m.leg_flight, times[e], places[e, i])
                sampling[e, i] = hover + _SAME_TIME < times[e] and times[e] <= m.leg_end + _SAME_TIME


class Surroundings:
    """Wind, plume and gas sensors of a World's episodes. `scene` is what the plume is in."""

    def __init__(self, scenario: Scenario, sources: FloatArray, strengths: FloatArray, n_uavs: int) -> None:
        """For worlds with `sources` (n_envs, n_sources, 3) m of relative `strengths` (n_envs, n_sources)."""
        n_envs = len(sources)
        self.plume: PlumeModel = scenario.plume
        self.wind: Wind = scenario.wind
        self.sensor: GasSensor = scenario.gas_sensor
        self.tick, self._wind_changes = scenario.tick, self.wind.changes
        self.smells = self.sensor.measures == "concentration"
        self._sensor_period = float(self.sensor.period) if self.smells else math.inf  # s
        self._period = scenario.decision_time if scenario.in_periods else 0.0  # s
        self._wind_state = self.wind.allocate(n_envs, scenario.arena)
        self.plume_state: Any = self.plume.allocate(n_envs, sources.shape[1], scenario.arena)
        self.scene = Scene(
            sources=sources,
            strengths=strengths,
            air=self._wind_state.air,
            geometry=scenario.arena.geometry,
            area=np.array(scenario.arena.size),
            positions=np.full((n_envs, n_uavs, 3), _FAR),
        )
        self.sniffers: StateArray | None = np.zeros((n_envs, n_uavs), SNIFFER) if self.smells else None
        self.response: StateArray | None = self.sensor.response() if self.smells else None
        self.faults: StateArray | None = fault_table(scenario.sensor_faults) if scenario.sensor_faults else None
        self.winds: FloatArray = (  # (n_envs, n_uavs, 3) m/s at the UAVs; (n_envs, 1, 3) where it is the same for all
            self._wind_state.air.mean[:, None, :] if self.wind.uniform else np.zeros((n_envs, n_uavs, 3))
        )
        self._sees = scenario.range_sensors
        self._walls = self.scene.area if scenario.arena.bounds == "hold" else np.full(3, np.inf)  # m, see ray_distance
        self.rests = self.tick == 0.0 and self.wind.uniform and self._sees.count == 0  # nothing for `follow` to do
        self.ranges: FloatArray = np.zeros((n_envs, n_uavs, self._sees.count))  # m
        self._range_streams = np.zeros((n_envs, n_uavs), np.uint64)
        self._concentration: FloatArray = np.zeros((n_envs, n_uavs))
        self._gives: BoolArray = np.zeros(n_envs, np.bool_)
        self._sampling: BoolArray = np.zeros((n_envs, n_uavs), np.bool_)
        self._ticks: IntArray = np.zeros(n_envs, np.int64)
        self._due: BoolArray = np.zeros(n_envs, np.bool_)
        self._times: FloatArray = np.zeros(n_envs)

    def begin(self, rows: IntArray, seeds: IntArray, episode: StateArray) -> None:
        """Begin the episodes with `seeds` in the worlds `rows`: their sources stand, their UAVs are not there yet."""
        lead = math.ceil(self.plume.lead_time / self.tick - _SAME_TIME) if self.tick > 0.0 else 0
        self.wind.begin(self._wind_state, rows, seeds, -lead * self.tick)
        self.plume.begin(self.plume_state, self.scene, rows, seeds)
        self.scene.positions[rows] = _FAR
        if self.sniffers is not None:
            begin_sniffers(self.sniffers, rows, seeds)
        if self._sees.count:
            begin_range_streams(self._range_streams, rows, seeds)
        self._ticks[rows] = -lead
        if lead:
            chosen = np.zeros(len(self._ticks), np.bool_)
            chosen[rows] = True
            self._go_on(chosen, np.zeros(len(self._ticks)))
        episode["wind"][rows] = self.scene.air.mean[rows]

    def follow(self, stepping: BoolArray, motion: StateArray, episode: StateArray) -> None:
        """Bring air, plume and sensors of the worlds of `stepping` (n_envs,) to their clocks, after a flight."""
        if self.tick > 0.0:
            self._go_on(stepping, np.ascontiguousarray(episode["clock"]), motion)
            if self._wind_changes:
                episode["wind"] = self.scene.air.mean
        if not self.wind.uniform:
            local_winds(self.scene.air, motion["position"], self.winds)
        if self._sees.count:
            self._look(stepping, motion)

    def _look(self, stepping: BoolArray, motion: StateArray) -> None:
        """What the range sensors of UAVs that decide now see; those in flight will look where they arrive."""
        scene, longest, seen = self.scene, self._sees.range, np.empty_like(self.ranges)
        looking = stepping[:, None] & motion["active"] & motion["ready"]
        range_readings(scene.geometry, self._walls, motion["position"], self._sees.count, longest, seen)
        add_range_noise(self._range_streams, looking, self._sees.noise, longest, seen)
        self.ranges[looking] = seen[looking]

    def go_on(self, seconds: float) -> None:
        """Let air and plume of all worlds go on for `seconds`, without anybody in them."""
        if self.tick > 0.0:
            self.scene.positions[:] = _FAR
            until = np.asarray(self._ticks * self.tick + seconds, dtype=np.float64)
            self._go_on(np.ones(len(self._ticks), np.bool_), until)

    def _go_on(self, stepping: BoolArray, until: FloatArray, motion: StateArray | None = None) -> None:
        due, times, scene = self._due, self._times, self.scene
        while _next_ticks(stepping, until, self.tick, self._ticks, due, times):
            if self._wind_changes:
                self.wind.advance(self._wind_state, due, times, self.tick)
            if motion is not None:
                _whereabouts(motion, until, due, times, self.tick, self._sensor_period, self._period,
                             scene.positions, self._gives, self._sampling)  # fmt: skip
            self.plume.advance(self.plume_state, scene, due)
            if motion is not None and self.sniffers is not None and self.response is not None:
                self.plume.read(self.plume_state, scene, scene.positions, due, self._concentration)
                sniff(self.sniffers, self.response, due, self._gives, self._sampling, self.tick, self._concentration)

    def read_rates(self, positions: FloatArray, stepping: BoolArray, rates: FloatArray) -> None:
        """The hit rates, 1/s, at the UAVs' `positions`, into `rates` (n_envs, n_uavs); nothing for sensors of
        concentration.
        """
        if not self.smells:
            self.plume.read(self.plume_state, self.scene, positions, stepping, rates)

    def reading(self, env: int, points: FloatArray) -> FloatArray:
        """The plume's present mean reading in world `env` at `points` (.., 3) m; shape (..)."""
        return self.plume.at(self.plume_state, self.scene, env, np.asarray(points, dtype=np.float64))

    def velocity(self, env: int, points: FloatArray) -> FloatArray:
        """The air's present velocity (.., 3), m/s, in world `env` at `points` (.., 3) m."""
        places = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        winds = np.empty_like(places)
        winds_at(self.scene.air, env, places, winds)
        return winds.reshape(np.shape(points))
