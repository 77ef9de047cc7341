"""The kernels that fly rigid bodies (quadrotors): periods with a setpoint or a velocity, and legs; and their ledger.

A body and its position controller run at the control period inside, whatever the decision period is. A place to fly to
that is farther than the lookahead (the vehicle's top speed over the ratio of its controller's gains) is cut to it, so
that the steady speed is at most `speed`. After each control step come, in this order: bounds, obstacles, energy.

A leg flies to its way point until it is within the arrival radius, then holds the place and samples. It is flown ahead
of time, with the wind that blows where and when it begins, when it is planned: the clocks then treat it as any other.
A leg that does not arrive (a headwind is too strong) ends after three times the time that it should take.

Under `arena.bounds: hold` a body that reaches the bounds is held there and loses its velocity across them; under `end`
it is lost once it is farther outside than the margin. A body that hits an obstacle and stops is caught: it hovers,
level, where it was stopped. A body whose flight becomes unstable (see `has_diverged`) stays at its last sound place and
is lost. Lost ones take no more samples.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.geometry import Geometry, flight_share
from osl_env.parameters import FloatArray
from osl_env.state import DIVERGED, FLYING, HOVERING, LEFT, RUNNING, SLIDE, BoolArray, IntArray, StateArray
from osl_env.vehicles.legs import is_lost
from osl_env.vehicles.point_mass import HOVERING_SPEED, SURFACES
from osl_env.vehicles.rigid_body import SCRATCH_SIZE, fly_step, has_diverged, hover_at
from osl_env.vehicles.rotor_power import electrical_power


@njit(cache=True, error_model="numpy")
def begin_bodies(body: FloatArray, frames: StateArray, motion: StateArray, rows: IntArray) -> None:
    """Let the bodies (n_envs, n_uavs, 17) of the worlds `rows` hover where their UAVs are."""
    for e in rows:
        for i in range(body.shape[1]):
            place = motion[e, i].position
            hover_at(frames[0], body[e, i], place[0], place[1], place[2])


@njit(error_model="numpy")
def _move_among(m: Any, c: Any, geometry: Any, frame: Any, state: Any, x: float, y: float, z: float) -> float:
    """The part of a body's way from (x, y, z), m, to where `state` has it that obstacles allow: the path flown, m."""
    path = 0.0
    dx, dy, dz = state[0] - x, state[1] - y, state[2] - z
    for _ in range(SURFACES):
        share, nx, ny, nz = flight_share(geometry, x, y, z, x + dx, y + dy, z + dz)
        path += share * math.sqrt(dx * dx + dy * dy + dz * dz)
        x, y, z = x + share * dx, y + share * dy, z + share * dz
        if share >= 1.0:
            break
        m.collided = True
        if c.collision != SLIDE:
            hover_at(frame, state, x, y, z)
            break
        inwards = min(state[3] * nx + state[4] * ny + state[5] * nz, 0.0)
        state[3] -= inwards * nx
        state[4] -= inwards * ny
        state[5] -= inwards * nz
        rest, inwards = 1.0 - share, min(dx * nx + dy * ny + dz * nz, 0.0)
        dx, dy, dz = rest * (dx - inwards * nx), rest * (dy - inwards * ny), rest * (dz - inwards * nz)
    state[0], state[1], state[2] = x, y, z
    return path


@njit(error_model="numpy")
def settle_body(
    m: Any, c: Any, geometry: Any, frame: Any, state: Any, x: float, y: float, z: float, may_leave: bool
) -> float:
    """What stops UAV `m`'s body on its way from (x, y, z), m, to where `state` (17,) has it: the path flown, m.

    Sets `m.fate` and `m.collided`. `may_leave`: the bounds do not hold it, but it is lost beyond the margin.
    """
    if has_diverged(state):
        m.fate = DIVERGED
        hover_at(frame, state, x, y, z)
        return 0.0
    for axis in range(3):
        if not may_leave and (state[axis] < 0.0 or state[axis] > c.area[axis]):
            state[axis] = min(max(state[axis], 0.0), c.area[axis])
            state[3 + axis] = 0.0
    if geometry is not None:
        path = _move_among(m, c, geometry, frame, state, x, y, z)
    else:
        path = math.sqrt((state[0] - x) ** 2 + (state[1] - y) ** 2 + (state[2] - z) ** 2)
    for axis in range(3):
        if may_leave and (state[axis] < -c.margin or state[axis] > c.area[axis] + c.margin):
            m.fate = LEFT
    return path


@njit(inline="always", error_model="numpy")
def _speed(state: Any) -> float:
    return math.sqrt(state[3] * state[3] + state[4] * state[4] + state[5] * state[5])


@njit(error_model="numpy")
def body_power(c: Any, frame: Any, rotors: Any, state: Any, wx: float, wy: float, wz: float) -> float:
    """W that a body draws now: from its rotors' thrust, or measured for flying and hovering."""
    if rotors is not None:
        return float(electrical_power(frame, rotors[0], state, wx, wy, wz))
    return float(c.flying_power if _speed(state) > HOVERING_SPEED else c.hovering_power)


@njit(inline="always", error_model="numpy")
def steer(frame: Any, state: Any, target: Any, tracks: bool, longest: float, wx: Any, wy: Any, wz: Any, w: Any) -> None:
    """One control period of a body towards the place, or with the velocity, `target` (3,), cut to `longest`, m or m/s.

    `w` is the scratch memory.
    """
    x, y, z = target[0], target[1], target[2]
    if tracks:
        x, y, z = x - state[0], y - state[1], z - state[2]
    length = math.sqrt(x * x + y * y + z * z)
    share = longest / length if length > longest else 1.0
    x, y, z = share * x, share * y, share * z
    if tracks:
        x, y, z = x + state[0], y + state[1], z + state[2]
    fly_step(frame, state, x, y, z, tracks, wx, wy, wz, w)


@njit(error_model="numpy")
def book_step(m: Any, book: Any, c: Any, frame: Any, state: Any, power: float, path: float) -> bool:
    """Enter one control step into the ledger, and where it has led; False once the UAV's flight is over."""
    dt = frame.control_period
    remaining = c.capacity - book.spent
    alive = power * dt < remaining
    if not alive:
        dt = max(remaining, 0.0) / power if power > 0.0 else 0.0
        m.exhausted = True
    flying = _speed(state) > HOVERING_SPEED
    book.energy[FLYING if flying else HOVERING] += power * dt
    book.spent += power * dt
    book.search_time += dt
    if flying:
        book.flying_time += dt
    else:
        book.hovering_time += dt
    book.path += path
    for axis in range(3):
        m.position[axis], m.velocity[axis] = state[axis], state[3 + axis]
    return bool(not is_lost(m, c))


@njit(error_model="numpy")
def begin_period(m: Any) -> None:
    """A decision period of one UAV begins."""
    m.samples, m.collided = 1, False
    for axis in range(3):
        m.origin[axis] = m.position[axis]


@njit(error_model="numpy")
def end_period(m: Any, book: Any, c: Any) -> None:
    """A decision period of one UAV is over."""
    if is_lost(m, c):
        m.samples = 0
    book.collisions += 1 if m.collided else 0
    book.decisions += 1
    book.flights += 1
    m.ready = True


@njit(cache=True, error_model="numpy")
def fly_body_periods(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    geometry: Geometry | None,
    body: FloatArray,
    frames: StateArray,
    rotors: StateArray | None,
    winds: FloatArray,
    stepping: BoolArray,
    targets: FloatArray,
    tracks: bool,
) -> None:
    """One decision period in every running world: `targets` (n_envs, n_uavs, 3) are places, m, or velocities, m/s.

    `tracks` says which. `winds` (n_envs, n_uavs or 1, 3) m/s. `rotors` is None where powers are measured ones.
    """
    n_envs, n_uavs = motion.shape
    c, frame, scratch = constants[0], frames[0], np.empty(SCRATCH_SIZE)
    longest = frame.lookahead if tracks else c.speed
    steps = round(c.decision_period / frame.control_period)
    for e in range(n_envs):
        stepping[e] = episode[e].outcome == RUNNING
        if not stepping[e]:
            continue
        for i in range(n_uavs):
            m, book, state = motion[e, i], ledger[e, i], body[e, i]
            if not m.active:
                continue
            wind = winds[e, i if winds.shape[1] > 1 else 0]
            wx, wy, wz = frame.feels_wind * wind[0], frame.feels_wind * wind[1], frame.feels_wind * wind[2]
            begin_period(m)
            for _ in range(steps):
                x, y, z = state[0], state[1], state[2]
                steer(frame, state, targets[e, i], tracks, longest, wx, wy, wz, scratch)
                path = settle_body(m, c, geometry, frame, state, x, y, z, c.bounds_end)
                power = body_power(c, frame, rotors, state, wx, wy, wz)
                if not book_step(m, book, c, frame, state, power, path):
                    break
            end_period(m, book, c)
        episode[e].clock += c.decision_period
