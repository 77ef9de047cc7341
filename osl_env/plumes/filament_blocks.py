"""How the filaments of a world are kept: contiguous arrays, in blocks of neighbours with a bounding box each.

A reading needs the filaments within their cut-off of a place. Lists of cells would have to be built anew at every
update, at the cost of the update itself. Instead the filaments are put, now and then, in the order of a Morton
(z-order) curve (Morton 1966; the longest side is halved first), so that any 64 in a row are neighbours; each such
block has a box, renewed at every update at nearly no cost, and a reading touches only the blocks whose box is within
reach. New filaments follow at the end, where they are neighbours too: they come from the sources. What has ended
keeps its slot, with no content, until the next ordering. One is due when an eighth of the slots has been released or
has ended since the last, and every 32 ticks: a rule of the world's own, so that row i of a batch is a batch of one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.geometry import clear_share
from osl_env.parameters import FloatArray
from osl_env.plumes.filament_noise import BLOCK, SingleArray, bits_to_single, single_to_bits
from osl_env.state import IntArray

X, Y, Z, VARIANCE, AGE, CONTENT = range(6)  # rows of `bodies`: m, m, m, m^2, s, unit m^3
N_BODY = 6
LOW_X, LOW_Y, LOW_Z, HIGH_X, HIGH_Y, HIGH_Z, WIDEST = range(7)  # rows of `boxes`: m, and the largest variance, m^2
N_BOX = 7
SLOTS, ENDED, SINCE, CHANGES, DROPPED, MERGED = range(6)  # columns of `tallies`
N_TALLY = 6
_MOST_INT, _SIGN = np.int32(2**31 - 1), np.int32(31)
_TICKS_BETWEEN = 32  # ticks after which filaments are put in order in any case


class FilamentState(NamedTuple):
    """The filaments of a batch of worlds: 24.5 bytes each, boxes included; ordering one world takes 12 more."""

    bodies: SingleArray  # (n_envs, 6, capacity): position x, y, z, variance, age, content (0: ended)
    boxes: SingleArray  # (n_envs, 7, capacity / 64): of the centres, and the largest variance
    tallies: IntArray  # (n_envs, 6): slots in use, of these ended, ticks and changes since ordering, dropped, merged
    owed: FloatArray  # (n_envs, n_sources): the fraction of the next filament
    streams: NDArray[np.uint64]  # (n_envs,), of Purpose.PLUME

    @property
    def live(self) -> IntArray:
        """Filaments in each world (n_envs,)."""
        live: IntArray = self.tallies[:, SLOTS] - self.tallies[:, ENDED]
        return live

    @property
    def dropped(self) -> IntArray:
        """Filaments that ended in each world (n_envs,) because there was no room."""
        dropped: IntArray = self.tallies[:, DROPPED]
        return dropped

    @property
    def merged(self) -> IntArray:
        """Filaments that went into a neighbour in each world (n_envs,) because there was no room."""
        merged: IntArray = self.tallies[:, MERGED]
        return merged


def empty_state(n_envs: int, n_sources: int, capacity: int) -> FilamentState:
    """Clean air with room for at least `capacity` filaments in each of `n_envs` worlds."""
    n_blocks = -(-capacity // BLOCK)
    return FilamentState(
        np.zeros((n_envs, N_BODY, n_blocks * BLOCK), np.float32),
        np.zeros((n_envs, N_BOX, n_blocks), np.float32),
        np.zeros((n_envs, N_TALLY), np.int64),
        np.zeros((n_envs, n_sources)),
        np.zeros(n_envs, np.uint64),
    )


@njit(error_model="numpy")
def _frame(boxes: Any, n_blocks: int, low: Any, side: Any) -> None:
    """Low corner and sides, m, of all boxes together, into `low` and `side` (3,)."""
    for axis in range(3):
        least, greatest = boxes[LOW_X + axis, 0], boxes[HIGH_X + axis, 0]
        for b in range(1, n_blocks):
            least = min(least, boxes[LOW_X + axis, b])
            greatest = max(greatest, boxes[HIGH_X + axis, b])
        low[axis], side[axis] = least, max(greatest - least, np.float32(1e-6))


@njit(error_model="numpy")
def _curve(bodies: Any, boxes: Any, n: int, bits: int, keys: Any) -> None:
    """Each filament's place on the curve, into `keys` (n,): `bits` halvings, each of the longest side left."""
    low, side = np.empty(3, np.float32), np.empty(3, np.float32)
    _frame(boxes, -(-n // BLOCK), low, side)
    axes, shifts, parts = np.empty(bits, np.int64), np.empty(bits, np.int64), np.zeros(3, np.int64)
    left = side.copy()
    for t in range(bits):
        axis = 0 if left[0] >= left[1] and left[0] >= left[2] else 1 if left[1] >= left[2] else 2
        left[axis] *= np.float32(0.5)
        parts[axis] += 1
        axes[t], shifts[t] = axis, parts[axis]
    places = np.empty(3, np.int64)
    for k in range(n):
        for axis in range(3):
            cells = 1 << parts[axis]
            place = np.int64((bodies[axis, k] - low[axis]) / side[axis] * np.float32(cells))
            places[axis] = min(max(place, 0), cells - 1)
        key = 0
        for t in range(bits):
            key = 2 * key + ((places[axes[t]] >> (parts[axes[t]] - shifts[t])) & 1)
        keys[k] = key


@njit(error_model="numpy")
def put_in_order(bodies: Any, boxes: Any, tally: Any) -> None:
    """Drop what has ended and sort the rest along the curve (a counting sort, stable); one world."""
    n = tally[SLOTS]
    tally[SINCE] = tally[CHANGES] = 0
    if n == 0:
        return
    bits = int(math.log2(n + 0.5))
    keys = np.empty(n, np.int32)
    _curve(bodies, boxes, n, bits, keys)
    ended = 1 << bits
    starts = np.zeros(ended + 2, np.int32)
    for k in range(n):
        if bodies[CONTENT, k] == 0.0:
            keys[k] = ended
    for k in range(n):
        starts[keys[k] + 1] += 1
    for key in range(ended):
        starts[key + 1] += starts[key]
    order = np.empty(n, np.int32)
    for k in range(n):
        if keys[k] < ended:
            order[starts[keys[k]]] = k
            starts[keys[k]] += 1
    live = starts[ended]
    row = keys.view(np.float32)
    for body in range(N_BODY):
        for k in range(live):
            row[k] = bodies[body, order[k]]
        bodies[body, :live] = row[:live]
    tally[SLOTS], tally[ENDED] = live, 0
    _close(bodies, boxes, live)


@njit(error_model="numpy")
def _close(bodies: Any, boxes: Any, n: int) -> None:
    """Fill the last block with copies of its last filament without content, and renew all boxes; one world."""
    for k in range(n, -(-n // BLOCK) * BLOCK):
        bodies[:, k] = bodies[:, n - 1]
        bodies[CONTENT, k] = 0.0
    for b in range(-(-n // BLOCK)):
        renew_box(bodies, boxes, b)


@njit(inline="always", error_model="numpy")
def _extremes(row: Any) -> Any:
    """Least and greatest of a row of BLOCK; of integers in the order of the floats, whose reductions vectorise."""
    low, high = np.int32(_MOST_INT), np.int32(-_MOST_INT)
    for k in range(BLOCK):
        bits: Any = single_to_bits(row[k])  # type: ignore[call-arg]
        key = np.int32(bits ^ np.int32(np.int32(bits >> _SIGN) & _MOST_INT))
        low, high = np.int32(min(low, key)), np.int32(max(high, key))
    low = np.int32(low ^ np.int32(np.int32(low >> _SIGN) & _MOST_INT))
    high = np.int32(high ^ np.int32(np.int32(high >> _SIGN) & _MOST_INT))
    return bits_to_single(low), bits_to_single(high)  # type: ignore[call-arg]


@njit(error_model="numpy")
def renew_box(bodies: Any, boxes: Any, b: int) -> None:
    """The box of block `b` of one world."""
    start = b * BLOCK
    boxes[LOW_X, b], boxes[HIGH_X, b] = _extremes(bodies[X, start : start + BLOCK])
    boxes[LOW_Y, b], boxes[HIGH_Y, b] = _extremes(bodies[Y, start : start + BLOCK])
    boxes[LOW_Z, b], boxes[HIGH_Z, b] = _extremes(bodies[Z, start : start + BLOCK])
    _, boxes[WIDEST, b] = _extremes(bodies[VARIANCE, start : start + BLOCK])


@njit(error_model="numpy")
def order_is_due(tally: Any) -> bool:
    """Whether enough has been released, has ended or has drifted since the last ordering."""
    return bool(tally[CHANGES] * 8 > tally[SLOTS] + 8 * BLOCK or tally[SINCE] >= _TICKS_BETWEEN)


@njit(error_model="numpy")
def drop_oldest(bodies: Any, tally: Any, n: int) -> None:
    """End the `n` oldest filaments of one world, whose slots are in order; of equal ages, the first slots."""
    slots = tally[SLOTS]
    low, high = np.float32(-1e9), np.float32(1e9)  # s: fewer than n are older than `high`, n or more than `low`
    while True:
        middle = np.float32(low + np.float32(high - low) * np.float32(0.5))
        if middle <= low or middle >= high:
            break
        older = 0
        for k in range(slots):
            older += bodies[AGE, k] > middle
        low, high = (middle, high) if older >= n else (low, middle)
    left = n
    for strictly in (True, False):
        for k in range(slots):
            old = bodies[AGE, k] > high if strictly else bodies[AGE, k] >= low
            if old and left > 0 and bodies[CONTENT, k] > 0.0:
                bodies[CONTENT, k] = 0.0
                left -= 1
    tally[ENDED] += n - left
    tally[DROPPED] += n - left


@njit(error_model="numpy")
def merge_neighbours(bodies: Any, tally: Any, geometry: Any) -> None:
    """Merge each filament of one world with the next of the curve, if no wall of `geometry` (None: none) is between.

    Content, centre of mass and second moment are kept: the pair's variance grows by that of the two centres, a third
    of it on each axis. The age is the younger one's.
    """
    for k in range(0, tally[SLOTS] - 1, 2):
        one, two = bodies[:, k], bodies[:, k + 1]
        if geometry is not None:
            x, y, z = float(two[X]), float(two[Y]), float(two[Z])
            if clear_share(geometry, float(one[X]), float(one[Y]), float(one[Z]), x, y, z) < 1.0:
                continue
        content = one[CONTENT] + two[CONTENT]
        share = two[CONTENT] / content
        dx, dy, dz = two[X] - one[X], two[Y] - one[Y], two[Z] - one[Z]
        between = share * (np.float32(1.0) - share) * (dx * dx + dy * dy + dz * dz) / np.float32(3.0)
        one[X], one[Y], one[Z] = one[X] + share * dx, one[Y] + share * dy, one[Z] + share * dz
        one[VARIANCE] = one[VARIANCE] + share * (two[VARIANCE] - one[VARIANCE]) + between
        one[AGE], one[CONTENT] = min(one[AGE], two[AGE]), content
        two[CONTENT] = 0.0
        tally[ENDED] += 1
        tally[MERGED] += 1
