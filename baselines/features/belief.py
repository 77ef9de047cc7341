"""Belief features: what a UAV's own particle belief says about the source, relative to the UAV.

The numbers, each in [-1, 1] (m: the belief's mean, S: its covariance, u: the UAV):

    offset        (m - u) over the area's longest side
    near          (m - u) / (|m - u| + 5 m), by axis: fine where the source is close
    spread        s / (s + 10 m) of the standard deviation s along each axis
    correlation   of the axes
    entropy       ln of the Gaussian's volume, less that of the prior, over 10; 0 at first, negative when it shrinks
    mass_here, mass_at_mean   belief within the success radius of the UAV, and of the mean
    hits, silence   hits known so far; time since the last of them (1: there has been none)
    map           belief in sectors around the UAV: three rings of horizontal distance, eight
                  directions, below and above

A belief knows of teammates only what the radio brings (`baselines.features.readings`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from baselines.belief.likelihood import hit_model
from baselines.features.belief_kernels import (
    HITS,
    LAST_HIT,
    MEMORY,
    MOMENTS,
    Float32Array,
    normalise,
    prior,
    update_clouds,
)
from baselines.features.belief_map import MAP_CELLS, mass_within, to_masses, write_map
from baselines.features.readings import Readings
from baselines.features.spec import BELIEF_NAMES, BeliefFeatures
from osl_env.observation import AGE_SCALE, READING_SCALE
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray, StateArray

NEAR_SCALE = 5.0  # m
SPREAD_SCALE = 10.0  # m
ENTROPY_SCALE = 10.0  # nats
_FLOOR = 0.01  # m^2, on the variances: spreads below 0.1 m are not told apart
_NUMBERS = len(BELIEF_NAMES)


@njit(inline="always", error_model="numpy")
def half_log_determinant(s: Any) -> float:
    """Half the logarithm of the determinant of the covariance in the moments `s` (12,), with the floor."""
    xx, yy, zz = s[3] + _FLOOR, s[7] + _FLOOR, s[11] + _FLOOR
    xy, xz, yz = s[4], s[5], s[8]
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return 0.5 * math.log(max(determinant, _FLOOR**3))


@njit(inline="always", error_model="numpy")
def _write_shape(s: Any, prior_entropy: float, row: Any, at: int) -> None:
    """Spread, correlation and entropy, from the moments `s` (12,)."""
    for axis in range(3):
        spread = math.sqrt(max(s[3 + 4 * axis], 0.0))
        row[at + axis] = spread / (spread + SPREAD_SCALE)
    vx, vy, vz = s[3] + _FLOOR, s[7] + _FLOOR, s[11] + _FLOOR
    row[at + 3] = min(max(s[4] / math.sqrt(vx * vy), -1.0), 1.0)
    row[at + 4] = min(max(s[5] / math.sqrt(vx * vz), -1.0), 1.0)
    row[at + 5] = min(max(s[8] / math.sqrt(vy * vz), -1.0), 1.0)
    row[at + 6] = min(max((half_log_determinant(s) - prior_entropy) / ENTROPY_SCALE, -1.0), 1.0)


@njit(cache=True, error_model="numpy")
def _write(
    motion: StateArray,
    episode: StateArray,
    clouds: Float32Array,
    moments: FloatArray,
    memory: FloatArray,
    scales: FloatArray,
    mask: BoolArray,
    out: Float32Array,
    start: int,
) -> None:
    """The features into `out` (n_worlds, n_uavs, ..) from column `start` on, in the worlds of `mask`.

    `scales`: the longest side, m; the prior's entropy; the success radius and the map's radii, m.
    """
    side, prior_entropy = scales[0], scales[1]
    radius, inner, outer = np.float32(scales[2]), np.float32(scales[3]), np.float32(scales[4])
    masses, cells = np.empty(clouds.shape[3], dtype=np.int32), np.empty(clouds.shape[3], dtype=np.int32)
    sums = np.empty((4, MAP_CELLS), dtype=np.int32)
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1] if mask[e] else 0):
            listener = min(i, clouds.shape[1] - 1)
            cloud, s, known, row = clouds[e, listener], moments[e, listener], memory[e, listener], out[e, i]
            u = motion[e, i].position
            dx, dy, dz = s[0] - u[0], s[1] - u[1], s[2] - u[2]
            near = math.sqrt(dx * dx + dy * dy + dz * dz) + NEAR_SCALE
            row[start], row[start + 1], row[start + 2] = dx / side, dy / side, dz / side
            row[start + 3], row[start + 4], row[start + 5] = dx / near, dy / near, dz / near
            px, py, pz = np.float32(u[0]), np.float32(u[1]), np.float32(u[2])
            if i == listener:
                to_masses(cloud, masses)
                _write_shape(s, prior_entropy, row, start + 6)
                mean = np.float32(s[0]), np.float32(s[1]), np.float32(s[2])
                row[start + 14] = mass_within(cloud, masses, mean[0], mean[1], mean[2], radius)
                row[start + 15] = known[HITS] / (known[HITS] + READING_SCALE)
                silence = episode[e].clock - known[LAST_HIT]
                row[start + 16] = silence / (silence + AGE_SCALE) if known[HITS] > 0.0 else 1.0
            else:  # the same for all who listen together
                for column in range(start + 6, start + _NUMBERS):
                    row[column] = out[e, 0, column]
            row[start + 13] = mass_within(cloud, masses, px, py, pz, radius)
            write_map(cloud, masses, px, py, pz, inner, outer, cells, sums, row, start + _NUMBERS)


class BeliefBank:
    """The beliefs of all listeners of a batch of worlds."""

    def __init__(
        self,
        feature: BeliefFeatures,
        area: FloatArray,
        plume: Any,
        gas_sensor: Any,
        success_radius: float,
        readings: Readings,
    ) -> None:
        """`plume` and `gas_sensor` as advertised. Raises InputError for a plume without hits."""
        model = hit_model(plume, gas_sensor, np.zeros(3))
        self._feature, self._readings = feature, readings
        self._area = np.array(area, dtype=np.float64)
        self._plume = np.array([
            model.strength, plume.diffusivity, plume.lifetime, model.clamp_distance, model.background,
            model.detection_probability, model.max_count,
        ])  # fmt: skip
        self._prior = prior(feature.particles, self._area)
        self._prior_moments = np.zeros(MOMENTS)
        masses = np.zeros(feature.particles, dtype=np.int32)
        normalise(self._prior, self._prior_moments, masses, float(self._area.max()))
        self._scales = np.array([
            self._area.max(), half_log_determinant(self._prior_moments), success_radius, feature.inner_radius,
            feature.outer_radius,
        ])  # fmt: skip
        listeners = readings.count.shape
        self.clouds: Float32Array = np.zeros((*listeners, *self._prior.shape), dtype=np.float32)
        self.moments = np.zeros((*listeners, MOMENTS))
        self._memory = np.zeros((*listeners, MEMORY))
        self._resamplings: IntArray = np.zeros(listeners, np.int64)

    def reset(self, mask: BoolArray) -> None:
        """Return to the prior in the worlds of `mask` (n_worlds,) bool."""
        self.clouds[mask] = self._prior
        self.moments[mask] = self._prior_moments
        self._memory[mask] = 0.0
        self._resamplings[mask] = 0

    def update(
        self,
        motion: StateArray,
        senses: StateArray,
        episode: StateArray,
        mask: BoolArray,
        out: Float32Array,
        start: int,
    ) -> None:
        """Take in the new readings; write `out` (n_worlds, n_uavs, ..) from column `start` on, where `mask`."""
        readings, feature = self._readings, self._feature
        update_clouds(
            motion, senses, readings.rows, readings.count, self._plume, self._area, feature.resample_below,
            feature.roughening, self.clouds, self.moments, self._memory, self._resamplings,
        )  # fmt: skip
        _write(motion, episode, self.clouds, self.moments, self._memory, self._scales, mask, out, start)
