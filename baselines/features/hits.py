"""History of readings: the last ones, latest first, with their offsets and ages (batched)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from baselines.belief.likelihood import READING_COLUMNS
from baselines.features.readings import Readings
from baselines.features.spec import HIT_NAMES, HitsFeatures
from osl_env.observation import AGE_SCALE, READING_SCALE, SAMPLING_SCALE
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray, StateArray

Float32Array = NDArray[np.float32]
_COLUMNS = len(HIT_NAMES)


@njit(cache=True, error_model="numpy")
def _remember(rows: FloatArray, count: IntArray, detections_only: bool, history: FloatArray, stored: IntArray) -> None:
    """Put the new `rows` into the rings `history` (n_worlds, n_listeners, length, 6); `stored` counts all so far."""
    for e in range(count.shape[0]):
        for listener in range(count.shape[1]):
            for f in range(count[e, listener]):
                row = rows[e, listener, f]
                if row[4] <= 0.0 or (detections_only and row[3] <= 0.0):
                    continue
                place = stored[e, listener] % history.shape[2]
                for column in range(row.shape[0]):
                    history[e, listener, place, column] = row[column]
                stored[e, listener] += 1


@njit(cache=True, error_model="numpy")
def _write(
    motion: StateArray,
    episode: StateArray,
    history: FloatArray,
    stored: IntArray,
    side: float,
    mask: BoolArray,
    out: Float32Array,
    start: int,
) -> None:
    """The features into `out` (n_worlds, n_uavs, ..) from column `start` on, in the worlds of `mask`.

    `side`: the area's longest side, m.
    """
    length = history.shape[2]
    for e in range(motion.shape[0]):
        if not mask[e]:
            continue
        for i in range(motion.shape[1]):
            listener = min(i, history.shape[1] - 1)
            known = stored[e, listener]
            position, row = motion[e, i].position, out[e, i]
            for k in range(length):
                at = start + k * _COLUMNS
                if k >= known:
                    row[at : at + _COLUMNS] = 0.0
                    continue
                reading = history[e, listener, (known - 1 - k) % length]
                age = episode[e].clock - reading[5]
                row[at] = 1.0
                for axis in range(3):
                    row[at + 1 + axis] = (reading[axis] - position[axis]) / side
                row[at + 4] = age / (age + AGE_SCALE)
                row[at + 5] = reading[3] / (reading[3] + READING_SCALE)
                row[at + 6] = reading[4] / (reading[4] + SAMPLING_SCALE)


class HitHistory:
    """The histories of all listeners of a batch of worlds."""

    def __init__(self, feature: HitsFeatures, area: FloatArray, readings: Readings) -> None:
        """`readings` are filled by their owner before each `update`."""
        self._feature, self._readings = feature, readings
        self._side = float(np.max(area))
        listeners = readings.count.shape
        self._history = np.zeros((*listeners, feature.length, READING_COLUMNS))
        self._stored: IntArray = np.zeros(listeners, np.int64)

    def reset(self, mask: BoolArray) -> None:
        """Forget the readings of the worlds in `mask` (n_worlds,) bool."""
        self._stored[mask] = 0

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
        readings = self._readings
        _remember(readings.rows, readings.count, self._feature.detections_only, self._history, self._stored)
        _write(motion, episode, self._history, self._stored, self._side, mask, out, start)
