"""The kernel that flies legs of rigid bodies (quadrotors); see `flying_bodies` for what a leg of theirs is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.flying_bodies import body_power, settle_body, steer
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from osl_env.state import RUNNING, BoolArray, IntArray, StateArray
from osl_env.vehicles.legs import SAME_PLACE, advance_to_next, complete_leg, is_lost, wait_for_slowest
from osl_env.vehicles.rigid_body import SCRATCH_SIZE

_OVERTIME, _GRACE = 3.0, 10.0  # a leg is given up after so many times its time, and so many s more


@njit(inline="always", error_model="numpy")
def _distance(state: Any, target: Any) -> float:
    return math.sqrt((target[0] - state[0]) ** 2 + (target[1] - state[1]) ** 2 + (target[2] - state[2]) ** 2)


@njit(error_model="numpy")
def _step(m: Any, c: Any, geometry: Any, frame: Any, rotors: Any, state: Any, wind: Any, scratch: Any) -> float:
    """One control step towards `m.target`, its path added to the leg's: the power, W."""
    x, y, z = state[0], state[1], state[2]
    wx, wy, wz = frame.feels_wind * wind[0], frame.feels_wind * wind[1], frame.feels_wind * wind[2]
    steer(frame, state, m.target, True, frame.lookahead, wx, wy, wz, scratch)
    m.leg_path += settle_body(m, c, geometry, frame, state, x, y, z, False)
    return body_power(c, frame, rotors, state, wx, wy, wz)


@njit(error_model="numpy")
def _fly_there(
    m: Any, c: Any, geometry: Any, frame: Any, rotors: Any, state: Any, wind: Any, budget: float, scratch: Any
) -> None:
    """The flight of a leg to `m.target` with `budget` J: until it has arrived, is stopped, or gives up."""
    dt = frame.control_period
    distance = _distance(state, m.target)
    longest = _GRACE + _OVERTIME * distance / c.speed
    while distance > frame.arrival_radius and m.leg_flight < longest:
        power = _step(m, c, geometry, frame, rotors, state, wind, scratch)
        if m.leg_flying_energy + power * dt >= budget:
            m.leg_flight += (budget - m.leg_flying_energy) / power if power > 0.0 else 0.0
            m.leg_flying_energy = budget
            m.exhausted = True
            return
        m.leg_flight += dt
        m.leg_flying_energy += power * dt
        if m.collided or is_lost(m, c):
            return
        distance = _distance(state, m.target)


@njit(error_model="numpy")
def _hold(
    m: Any, c: Any, geometry: Any, frame: Any, rotors: Any, state: Any, wind: Any, budget: float, scratch: Any
) -> None:
    """The hover of a leg, which may use `budget` J, at `m.target`."""
    duration = m.samples * c.hover_time
    steps = max(1, round(duration / frame.control_period))
    dt, collided = duration / steps, m.collided
    for _ in range(steps):
        power = _step(m, c, geometry, frame, rotors, state, wind, scratch)
        m.collided = collided  # drifting against what has stopped it is no second collision
        if m.leg_hovering_energy + power * dt >= budget:
            m.leg_hover += (budget - m.leg_hovering_energy) / power if power > 0.0 else 0.0
            m.leg_hovering_energy = budget
            m.exhausted = True
            return
        m.leg_hover += dt
        m.leg_hovering_energy += power * dt
        if is_lost(m, c):
            return
    m.leg_hover = duration


@njit(error_model="numpy")
def _plan_leg(
    m: Any,
    book: Any,
    c: Any,
    geometry: Any,
    frame: Any,
    rotors: Any,
    state: Any,
    wind: Any,
    clock: float,
    samples: int,
    scratch: Any,
) -> None:
    """Fly one UAV's leg to `m.target` ahead of time: its times, path and energies, and where it ends."""
    m.turns, m.collided, m.samples = 0, False, samples
    m.leg_turn = m.leg_flight = m.leg_hover = m.leg_path = 0.0
    m.leg_flying_energy = m.leg_hovering_energy = 0.0
    for axis in range(3):
        m.origin[axis] = m.position[axis]
    length = _distance(state, m.target)
    if length > SAME_PLACE:
        for axis in range(3):
            m.heading[axis] = (m.target[axis] - state[axis]) / length
    budget = max(c.capacity - book.spent, 0.0)
    _fly_there(m, c, geometry, frame, rotors, state, wind, budget, scratch)
    if _distance(state, m.target) > frame.arrival_radius:
        for axis in range(3):
            m.target[axis] = state[axis]
    if not is_lost(m, c):
        _hold(m, c, geometry, frame, rotors, state, wind, budget - m.leg_flying_energy, scratch)
    if is_lost(m, c):
        m.samples = 0
    for axis in range(3):
        m.target[axis] = state[axis]
    m.leg_end = clock + (m.leg_flight + m.leg_hover)
    m.ready = False


@njit(cache=True, error_model="numpy")
def fly_body_legs(
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
    samples: IntArray,
) -> None:
    """One step of legs in every running world; arguments as for `fly_waypoints` and `fly_body_periods`."""
    n_envs, n_uavs = motion.shape
    c, frame, scratch = constants[0], frames[0], np.empty(SCRATCH_SIZE)
    for e in range(n_envs):
        stepping[e] = episode[e].outcome == RUNNING
        if not stepping[e]:
            continue
        for i in range(n_uavs):
            m = motion[e, i]
            if not (m.active and m.ready):
                continue
            for axis in range(3):
                m.target[axis] = min(max(targets[e, i, axis], 0.0), c.area[axis])
            wind = winds[e, i if winds.shape[1] > 1 else 0]
            count = min(max(samples[e, i], 1), c.max_samples)
            _plan_leg(m, ledger[e, i], c, geometry, frame, rotors, body[e, i], wind, episode[e].clock, count, scratch)
            if not c.event_clock:
                complete_leg(m, ledger[e, i], c)
        if c.event_clock:
            advance_to_next(motion, ledger, episode, c, e)
        else:
            wait_for_slowest(motion, ledger, episode, c, e)
