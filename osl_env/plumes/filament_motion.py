"""A tick of the filaments: release, move with the air, grow, end.

Every filament moves by v dt + s sqrt(dt) N(0, 1)^3 (Farrell et al. 2002, with the small scales as white noise; the
noise scales with sqrt(dt), so that the plume does not depend on the step) and its variance grows by gamma dt. One
that is released within a tick has its share of the tick to move and grow. Vectorised by the block where the air has
no walls; among walls each move is checked along its whole path.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.air import Air, air_velocity
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from osl_env.plumes.downwash import Wake, blow
from osl_env.plumes.filament_blocks import (
    AGE,
    CHANGES,
    CONTENT,
    ENDED,
    SINCE,
    SLOTS,
    VARIANCE,
    FilamentState,
    X,
    Y,
    Z,
    drop_oldest,
    merge_neighbours,
    order_is_due,
    put_in_order,
    renew_box,
)
from osl_env.plumes.filament_noise import BLOCK, WORDS, draw_normals
from osl_env.plumes.filament_walls import OPEN, REFLECT, move_among_walls
from osl_env.state import BoolArray, IntArray
from osl_env.streams import derive

REFUSE, OLDEST, MERGE = 0, 1, 2  # what happens when there is no room
_PLUME = 3  # Purpose.PLUME, for compiled code
_ROUNDING = 1e-9  # of a filament: sums of rate * dt that should be whole are
_F = np.float32
_ZERO = _F(0.0)


class Law(NamedTuple):
    """A filament plume's parameters in the kernels' form."""

    step: float  # s
    rate: float  # filaments/s of a source
    content: float  # unit m^3, of a filament of a source with strength 1
    variance: float  # m^2, at the release
    growth: float  # m^2/s, of the variance
    noise: float  # m/s^0.5
    rise: float  # m/s
    max_age: float  # s
    margin: float  # m, outside the open sides
    floor: int
    when_full: int
    wake: Wake


@njit(cache=True, error_model="numpy")
def clear_worlds(state: FilamentState, rows: IntArray, seeds: IntArray) -> None:
    """Clean air in the worlds `rows` (n,), with the streams of the episodes with `seeds` (n,)."""
    for k in range(rows.shape[0]):
        state.tallies[rows[k], :] = 0
        state.owed[rows[k], :] = 0.5  # the released number is that of rate * time, rounded
        state.streams[rows[k]] = derive(seeds[k], _PLUME, 0)


@njit(error_model="numpy")
def _make_room(bodies: Any, boxes: Any, tally: Any, wanted: int, geometry: Any, law: Any) -> int:
    """Room for `wanted` more filaments in one world, as far as there is any; how many were given up for it."""
    capacity = bodies.shape[1]
    before = 0
    for attempt in range(3):  # drop what has ended; merge; drop the oldest
        if attempt == 1 and law.when_full == MERGE:
            merge_neighbours(bodies, tally, geometry)
        elif attempt == 2:
            drop_oldest(bodies, tally, tally[SLOTS] + wanted - capacity)
        put_in_order(bodies, boxes, tally)
        before = tally[SLOTS] if attempt == 0 else before
        if tally[SLOTS] + wanted <= capacity:
            break
    return int(before - tally[SLOTS])


@njit(error_model="numpy")
def _release(state: Any, e: int, sources: Any, strengths: Any, geometry: Any, law: Any) -> int:
    """Append this tick's filaments, at the sources and with ages from -dt on (their moves come next).

    Returns how many filaments were given up for want of room.
    """
    bodies, boxes, tally, owed = state.bodies[e], state.boxes[e], state.tallies[e], state.owed[e]
    lost = 0
    for s in range(sources.shape[0]):
        before = owed[s]
        after = before + law.rate * law.step
        new = math.floor(after + _ROUNDING)
        owed[s] = max(after - new, 0.0)
        new = min(new, bodies.shape[1])
        if strengths[s] <= 0.0 or new == 0:
            continue
        if tally[SLOTS] + new > bodies.shape[1]:
            lost += _make_room(bodies, boxes, tally, new, geometry, law)
        first = tally[SLOTS]
        last = first + new
        for k in range(first, -(-last // BLOCK) * BLOCK):
            bodies[X, k], bodies[Y, k], bodies[Z, k] = sources[s, 0], sources[s, 1], sources[s, 2]
            bodies[VARIANCE, k] = law.variance
            bodies[AGE, k] = -min((k - first + 1 - before) / law.rate, law.step)
            bodies[CONTENT, k] = law.content * strengths[s] if k < last else 0.0
        for b in range(first // BLOCK, -(-last // BLOCK)):
            renew_box(bodies, boxes, b)
        tally[SLOTS] = last
        tally[CHANGES] += new
    return lost


@njit(error_model="numpy")
def _advise(air: Any, e: int, bodies: Any, start: int, law: Any, velocity: Any) -> None:
    """The air's velocity at the filaments of a block, into `velocity` (3, BLOCK)."""
    for k in range(BLOCK):
        x, y, z = bodies[X, start + k], bodies[Y, start + k], bodies[Z, start + k]
        u, v, w = air_velocity(air, e, float(x), float(y), float(z))
        velocity[0, k], velocity[1, k], velocity[2, k] = u, v, w + law.rise


@njit(error_model="numpy")
def _blow_block(bodies: Any, start: int, uavs: Any, law: Any, move: Any) -> None:
    """Add what the UAVs' wakes do to the moves of a block, and to its variances."""
    for k in range(BLOCK):
        x, y, z = float(bodies[X, start + k]), float(bodies[Y, start + k]), float(bodies[Z, start + k])
        span = min(float(bodies[AGE, start + k]), law.step)
        fall, growth = blow(law.wake, uavs, x, y, z, span)
        move[2, k] += _F(fall)
        bodies[VARIANCE, start + k] += _F(growth)


@njit(error_model="numpy")
def _age_and_move(bodies: Any, start: int, law: Any, velocity: Any, noise: Any, spans: Any, move: Any) -> None:
    """Age and grow a block, and its moves into `move` (3, BLOCK). Loops with one output each: LLVM vectorises them."""
    ages, variances = bodies[AGE, start : start + BLOCK], bodies[VARIANCE, start : start + BLOCK]
    step, strength, growth = _F(law.step), _F(law.noise), _F(law.growth)
    span, scale = spans[0], spans[1]
    for k in range(BLOCK):
        ages[k] += step
    for k in range(BLOCK):
        span[k] = min(ages[k], step)
    for k in range(BLOCK):
        scale[k] = strength * math.sqrt(span[k])
    for k in range(BLOCK):
        variances[k] += growth * span[k]
    for axis in range(3):
        speed, draws, way = velocity[axis], noise[axis * BLOCK : (axis + 1) * BLOCK], move[axis]
        for k in range(BLOCK):
            way[k] = speed[k] * span[k] + scale[k] * draws[k]


@njit(error_model="numpy")
def _move_freely(bodies: Any, start: int, bounds: Any, law: Any, move: Any) -> None:
    """Move a block where nothing is in the way but the floor; what leaves or is too old ends."""
    contents, ages = bodies[CONTENT, start : start + BLOCK], bodies[AGE, start : start + BLOCK]
    oldest = _F(law.max_age)
    for axis in range(3):
        places, way = bodies[X + axis, start : start + BLOCK], move[axis]
        low, high = bounds[axis], bounds[3 + axis]
        for k in range(BLOCK):
            places[k] += way[k]
        if axis == 2 and law.floor == REFLECT:
            for k in range(BLOCK):
                place = places[k]
                places[k] = max(place, -place)
        for k in range(BLOCK):
            place, content = places[k], contents[k]
            contents[k] = content if (place >= low) & (place <= high) else _ZERO
    for k in range(BLOCK):
        age, content = ages[k], contents[k]
        contents[k] = content if age <= oldest else _ZERO


@njit(error_model="numpy")
def _count_empty(contents: Any) -> int:
    """How many of a block have no content."""
    empty = np.int32(0)
    for k in range(BLOCK):
        empty = np.int32(empty + np.int32(contents[k] == _ZERO))
    return int(empty)


@njit(error_model="numpy")
def _bounds(area: Any, law: Any) -> Any:
    """Low and high corner, m, of where filaments live; (6,)."""
    bounds = np.empty(6, np.float32)
    for axis in range(3):
        bounds[axis], bounds[3 + axis] = -law.margin, area[axis] + law.margin
    if law.floor != OPEN:
        bounds[2] = 0.0
    return bounds


@njit(error_model="numpy")
def _advance_world(
    state: Any, e: int, air: Any, geometry: Any, area: Any, uavs: Any, law: Any, scratch: Any, words: Any
) -> None:
    """Move, grow and end the filaments of one world, block by block."""
    bodies, boxes, tally = state.bodies[e], state.boxes[e], state.tallies[e]
    velocity, move, spans, noise = scratch[:3], scratch[3:6], scratch[6:8], scratch[8:].reshape(3 * BLOCK)
    bounds = _bounds(area, law)
    uniform = air.grid.shape[0] == 0
    n_blocks = -(-tally[SLOTS] // BLOCK)
    stream = state.streams[e]
    if uniform:
        velocity[0, :], velocity[1, :], velocity[2, :] = air.mean[e, 0], air.mean[e, 1], air.mean[e, 2] + law.rise
    empty = 0
    for b in range(n_blocks):
        start = b * BLOCK
        if not uniform:
            _advise(air, e, bodies, start, law, velocity)
        stream = draw_normals(stream, words[0], words[1], noise)
        _age_and_move(bodies, start, law, velocity, noise, spans, move)
        if law.wake.radius > 0.0:
            _blow_block(bodies, start, uavs, law, move)
        if geometry is None:
            _move_freely(bodies, start, bounds, law, move)
        else:
            move_among_walls(bodies, start, bounds, geometry, law.floor, law.max_age, move)
        empty += _count_empty(bodies[CONTENT, start : start + BLOCK])
        renew_box(bodies, boxes, b)
    state.streams[e] = stream
    ended = empty - (n_blocks * BLOCK - tally[SLOTS])
    tally[CHANGES] += ended - tally[ENDED]
    tally[ENDED] = ended
    tally[SINCE] += 1
    if order_is_due(tally):
        put_in_order(bodies, boxes, tally)


@njit(cache=True, error_model="numpy")
def advance_worlds(
    state: FilamentState,
    sources: FloatArray,
    strengths: FloatArray,
    air: Air,
    geometry: Geometry | None,
    area: FloatArray,
    uavs: FloatArray,
    due: BoolArray,
    law: Law,
) -> int:
    """One tick of the worlds of `due`; how many filaments were given up for want of room.

    `geometry` is None where there is none: the kernel is then compiled without walls.
    """
    scratch = np.empty((11, BLOCK), np.float32)
    words = np.empty((2, WORDS), np.int32)
    lost = 0
    for e in range(due.shape[0]):
        if due[e]:
            lost += _release(state, e, sources[e], strengths[e], geometry, law)
            _advance_world(state, e, air, geometry, area, uavs[e], law, scratch, words)
    return lost
