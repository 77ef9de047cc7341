"""The kernels that write observations: physical rows in double precision, flat vectors in single precision.

A row holds, in this order, a UAV's own numbers, its remembered detections, the neighbours that it has heard, what its
range sensors see; then what is in physical observations only (mission clock, decisions, neighbours' numbers). The
fields, their units and scales are defined in `osl_env.observation`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.parameters import FloatArray
from osl_env.state import DETECTION_MEMORY, StateArray

_K = DETECTION_MEMORY
DETECTION_SIZE = 6  # mask, age, offset (3), reading
NEIGHBOUR_SIZE = 7  # mask, offset (3), reading, sampling time, age
HEAD_SIZE = 17
DETECTIONS_END = HEAD_SIZE + _K * DETECTION_SIZE
BLOCK = 32  # UAVs whose rows are written before they are normalised


@njit(inline="always", error_model="numpy")
def _write_row(motion: Any, ledger: Any, senses: Any, clock: float, numbers: Any, row: Any, extra: Any) -> None:
    """The physical row of one UAV, without its neighbours."""
    for axis in range(3):
        row[axis] = motion.position[axis]
        row[3 + axis] = numbers[axis]
        row[6 + axis] = motion.velocity[axis]
        row[9 + axis] = senses.wind[axis]
    row[12] = 1.0 if motion.active and motion.ready else 0.0
    row[13] = senses.reading
    row[14] = senses.sampling_time
    row[15] = max(0.0, numbers[3] - ledger.spent)
    row[16] = max(0.0, numbers[4] - ledger.search_time)
    extra[0] = clock
    extra[1] = float(ledger.decisions)
    at = HEAD_SIZE
    for k in range(_K):
        if k < senses.detections:
            row[at] = 1.0
            row[at + 1] = clock - senses.detection_time[k]
            for axis in range(3):
                row[at + 2 + axis] = senses.detection_position[k, axis] - motion.position[axis]
            row[at + 5] = senses.detection_reading[k]
        else:
            for column in range(DETECTION_SIZE):
                row[at + column] = 0.0
        at += DETECTION_SIZE


@njit(inline="always", error_model="numpy")
def _squared(dx: Any, dy: Any, dz: Any) -> Any:
    """Squared distance in single precision: both forms of an observation must order their neighbours alike."""
    u, v, w = np.float32(dx), np.float32(dy), np.float32(dz)
    return u * u + v * v + w * w


@njit(inline="always", error_model="numpy")
def _write_neighbours(
    motion: Any,
    senses: Any,
    heard: Any,
    to_all: bool,
    e: int,
    own: int,
    clock: float,
    n_neighbours: int,
    row: Any,
    extra: Any,
) -> None:
    """The neighbour table of UAV `own` of world `e`: the nearest heard ones, by insertion into the table."""
    position = motion[e, own].position
    count = 0
    for j in range(motion.shape[1] if n_neighbours > 0 else 0):
        if j == own or (not to_all and not heard[e, own, j].known):
            continue
        sent = motion[e, j].position if to_all else heard[e, own, j].position
        dx, dy, dz = sent[0] - position[0], sent[1] - position[1], sent[2] - position[2]
        squared = _squared(dx, dy, dz)
        slot = count
        while slot > 0:
            at = DETECTIONS_END + (slot - 1) * NEIGHBOUR_SIZE
            if _squared(row[at + 1], row[at + 2], row[at + 3]) <= squared:
                break
            if slot < n_neighbours:
                for column in range(NEIGHBOUR_SIZE):
                    row[at + NEIGHBOUR_SIZE + column] = row[at + column]
                extra[2 + slot] = extra[1 + slot]
            slot -= 1
        if slot < n_neighbours:
            at = DETECTIONS_END + slot * NEIGHBOUR_SIZE
            row[at], row[at + 1], row[at + 2], row[at + 3] = 1.0, dx, dy, dz
            if to_all:
                row[at + 4], row[at + 5] = senses[e, j].reading, senses[e, j].sampling_time
                row[at + 6] = clock - senses[e, j].sent_time
            else:
                frame = heard[e, own, j]
                row[at + 4], row[at + 5], row[at + 6] = frame.reading, frame.sampling_time, clock - frame.time
            extra[2 + slot] = float(j)
        count = min(count + 1, n_neighbours)
    for slot in range(count, n_neighbours):
        at = DETECTIONS_END + slot * NEIGHBOUR_SIZE
        for column in range(NEIGHBOUR_SIZE):
            row[at + column] = 0.0
        extra[2 + slot] = -1.0


@njit(cache=True, error_model="numpy")
def write_physical(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    episode: StateArray,
    ranges: FloatArray,
    numbers: FloatArray,
    n_neighbours: int,
    to_all: bool,
    rows: FloatArray,
) -> None:
    """The physical rows of all UAVs, into `rows` (n_envs, n_uavs, size); `ranges` (n_envs, n_uavs, n_rays), m."""
    n_envs, n_uavs = motion.shape
    width = rows.shape[2] - 2 - n_neighbours
    for e in range(n_envs):
        clock = episode[e].clock
        for i in range(n_uavs):
            row, extra = rows[e, i, :width], rows[e, i, width:]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, to_all, e, i, clock, n_neighbours, row, extra)
            for k in range(ranges.shape[2]):
                row[width - ranges.shape[2] + k] = ranges[e, i, k]


@njit(cache=True, error_model="numpy")
def write_flat(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    episode: StateArray,
    ranges: FloatArray,
    numbers: FloatArray,
    n_neighbours: int,
    to_all: bool,
    transform: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Rows in blocks of UAVs, then their normalisation in one long loop over the block, which vectorises."""
    n_uavs = motion.shape[1]
    n, width = motion.size, out.shape[2]
    flat = out.reshape(-1)
    rows = np.zeros((min(BLOCK, n), width), dtype=np.float32)
    numbers_of_row = rows.reshape(-1)
    extra = np.zeros(2 + n_neighbours, dtype=np.float32)
    gain, offset, bend, base = transform[0], transform[1], transform[2], transform[3]
    one = np.float32(1.0)
    e, i = 0, 0
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        for b in range(count):
            clock, row = episode[e].clock, rows[b]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, to_all, e, i, clock, n_neighbours, row, extra)
            for k in range(ranges.shape[2]):
                row[width - ranges.shape[2] + k] = ranges[e, i, k]
            i += 1
            if i == n_uavs:
                e, i = e + 1, 0
        normalised = flat[start * width : (start + count) * width]
        for k in range(normalised.size):
            x = numbers_of_row[k]
            y = (x * gain[k] + offset[k]) / (abs(x) * bend[k] + base[k])
            normalised[k] = min(max(y, -one), one)
