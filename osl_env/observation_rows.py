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

from osl_env.numerics import float_to_bits
from osl_env.parameters import FloatArray
from osl_env.radio import ContactArray
from osl_env.state import DETECTION_MEMORY, StateArray

_K = DETECTION_MEMORY
DETECTION_SIZE = 6  # mask, age, offset (3), reading
NEIGHBOUR_SIZE = 7  # mask, offset (3), reading, sampling time, age
HEAD_SIZE = 17
DETECTIONS_END = HEAD_SIZE + _K * DETECTION_SIZE
_NUMBER = (1 << 29) - 1  # bits of a double that a number in single precision leaves at zero
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


@njit(error_model="numpy")
def _find_nearest(motion: Any, heard: Any, contacts: Any, to_all: bool, e: int, own: int, nearest: Any) -> int:
    """The nearest of those that UAV `own` of world `e` has heard, into `nearest` (n_neighbours,); returns how many.

    By insertion of keys that order as (distance, number) do: the bits of the squared distance in single precision (so
    that both forms of an observation order their neighbours alike), with the number in bits that it leaves free.
    """
    position, most, n = motion[e, own].position, nearest.size, 0
    for k in range(motion.shape[1] if to_all else contacts[e, own, 0]):
        j = k if to_all else int(contacts[e, own, 1 + k])
        if j == own:
            continue
        place = motion[e, j].position if to_all else heard[e, own, j].position
        dx, dy, dz = place[0] - position[0], place[1] - position[1], place[2] - position[2]
        u, v, w = np.float32(dx), np.float32(dy), np.float32(dz)
        key = float_to_bits(float(u * u + v * v + w * w)) | j  # type: ignore[call-arg]
        if n == most and key >= nearest[most - 1]:
            continue
        slot = min(n, most - 1)
        while slot > 0 and nearest[slot - 1] > key:
            nearest[slot] = nearest[slot - 1]
            slot -= 1
        nearest[slot] = key
        n = min(n + 1, most)
    return n


@njit(inline="always", error_model="numpy")
def _write_neighbours(
    motion: Any,
    senses: Any,
    heard: Any,
    contacts: Any,
    to_all: bool,
    e: int,
    own: int,
    clock: float,
    nearest: Any,
    row: Any,
    extra: Any,
) -> None:
    """The neighbour table of UAV `own` of world `e`; `nearest` (n_neighbours,) is room to find them."""
    if nearest.size == 0:
        return
    count, position = _find_nearest(motion, heard, contacts, to_all, e, own, nearest), motion[e, own].position
    for slot in range(nearest.size):
        at = DETECTIONS_END + slot * NEIGHBOUR_SIZE
        if slot >= count:
            for column in range(NEIGHBOUR_SIZE):
                row[at + column] = 0.0
            extra[2 + slot] = -1.0
            continue
        j = nearest[slot] & _NUMBER
        place = motion[e, j].position if to_all else heard[e, own, j].position
        row[at] = 1.0
        for axis in range(3):
            row[at + 1 + axis] = place[axis] - position[axis]
        if to_all:
            row[at + 4], row[at + 5] = senses[e, j].reading, senses[e, j].sampling_time
            row[at + 6] = clock - senses[e, j].sent_time
        else:
            frame = heard[e, own, j]
            row[at + 4], row[at + 5], row[at + 6] = frame.reading, frame.sampling_time, clock - frame.time
        extra[2 + slot] = float(j)


@njit(cache=True, error_model="numpy")
def write_physical(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    contacts: ContactArray,
    episode: StateArray,
    ranges: FloatArray,
    numbers: FloatArray,
    n_neighbours: int,
    to_all: bool,
    rows: FloatArray,
) -> None:
    """The physical rows of all UAVs, into `rows` (n_envs, n_uavs, size); `ranges` (n_envs, n_uavs, n_rays), m."""
    n_envs, n_uavs = motion.shape
    width, nearest = rows.shape[2] - 2 - n_neighbours, np.empty(n_neighbours, np.int64)
    for e in range(n_envs):
        clock = episode[e].clock
        for i in range(n_uavs):
            row, extra = rows[e, i, :width], rows[e, i, width:]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, contacts, to_all, e, i, clock, nearest, row, extra)
            for k in range(ranges.shape[2]):
                row[width - ranges.shape[2] + k] = ranges[e, i, k]


@njit(cache=True, error_model="numpy")
def write_flat(
    motion: StateArray,
    ledger: StateArray,
    senses: StateArray,
    heard: StateArray,
    contacts: ContactArray,
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
    extra, nearest = np.zeros(2 + n_neighbours, dtype=np.float32), np.empty(n_neighbours, np.int64)
    gain, offset, bend, base = transform[0], transform[1], transform[2], transform[3]
    one = np.float32(1.0)
    e, i = 0, 0
    for start in range(0, n, BLOCK):
        count = min(BLOCK, n - start)
        for b in range(count):
            clock, row = episode[e].clock, rows[b]
            _write_row(motion[e, i], ledger[e, i], senses[e, i], clock, numbers, row, extra)
            _write_neighbours(motion, senses, heard, contacts, to_all, e, i, clock, nearest, row, extra)
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
