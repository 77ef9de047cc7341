"""The kernels that fly points: one step of hops, legs or periods in all worlds, and their clocks.

A leg that would meet an obstacle ends before it: at the surface less the clearance, or, on the grid of hops, at the end
of the longest hop in its direction that is clear; time, energy and path are those of what is flown. The collision is
counted. By the scenario's rule the UAV then goes on as if nothing had happened (`stop`, and `slide`, which differs in
velocity mode only: the motion along the surface is kept), or its flight is over (`end`).

`geometry` is None where there are no obstacles: the kernels are then compiled without all that.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from osl_env.geometry import Geometry, flight_share
from osl_env.parameters import FloatArray
from osl_env.state import RUNNING, BoolArray, IntArray, StateArray
from osl_env.vehicles.legs import (
    SAME_PLACE,
    advance_to_next,
    begin_leg,
    clear_hop,
    complete_leg,
    flight_time,
    hop_inside,
    is_clear_hop,
    wait_for_slowest,
)
from osl_env.vehicles.point_mass import fly_period


@njit(cache=True, error_model="numpy")
def fly_hops(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    geometry: Geometry | None,
    stepping: BoolArray,
    actions: IntArray,
    table: FloatArray,
) -> None:
    """One step of hops in every running world: fly, and advance the clocks.

    `actions` (n_envs, n_uavs) are rows of `table` (see `hop_table`). A hop that would leave the area or meet an
    obstacle is shortened to the longest one that does not. Writes which worlds flew to `stepping`.
    """
    n_envs, n_uavs = motion.shape
    c = constants[0]
    hover = table.shape[0] - 1
    for e in range(n_envs):
        stepping[e] = episode[e].outcome == RUNNING
        if not stepping[e]:
            continue
        clock = episode[e].clock
        for i in range(n_uavs):
            m = motion[e, i]
            if m.active and m.ready:
                k = hop_inside(m.position, c.area, table, actions[e, i], c.hop_lengths, hover)
                m.collided = False
                if geometry is not None:
                    wanted = k
                    k = clear_hop(geometry, m.position, table, wanted, c.hop_lengths, hover)
                    m.collided = k != wanted
                for axis in range(3):
                    m.target[axis] = m.position[axis] + table[k, axis]
                begin_leg(m, ledger[e, i], c, clock, table[k, 3], table[k, 4], table[k, 5], table[k, 6], table[k, 7], 1)
                if not c.event_clock:
                    complete_leg(m, ledger[e, i], c)
        if c.event_clock:
            advance_to_next(motion, ledger, episode, c, e)
        else:
            wait_for_slowest(motion, ledger, episode, c, e)


@njit(cache=True, error_model="numpy")
def fly_waypoints(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    geometry: Geometry | None,
    stepping: BoolArray,
    targets: FloatArray,
    samples: IntArray,
) -> None:
    """One step of legs in every running world: fly, and advance the clocks.

    Legs go to `targets` (n_envs, n_uavs, 3), m, clipped into the area, with `samples` (n_envs, n_uavs) samples at
    their ends. Writes which worlds flew to `stepping`.
    """
    n_envs, n_uavs = motion.shape
    c = constants[0]
    flight = np.empty(3)
    for e in range(n_envs):
        stepping[e] = episode[e].outcome == RUNNING
        if not stepping[e]:
            continue
        clock = episode[e].clock
        for i in range(n_uavs):
            m = motion[e, i]
            if not (m.active and m.ready):
                continue
            for axis in range(3):
                m.target[axis] = min(max(targets[e, i, axis], 0.0), c.area[axis])
            if c.planar:
                m.target[2] = m.position[2]
            m.collided = False
            if geometry is not None:
                x, y, z = m.position[0], m.position[1], m.position[2]
                share = flight_share(geometry, x, y, z, m.target[0], m.target[1], m.target[2])[0]
                if share < 1.0:
                    m.collided = True
                    for axis in range(3):
                        m.target[axis] = m.position[axis] + share * (m.target[axis] - m.position[axis])
            squared = 0.0
            for axis in range(3):
                flight[axis] = m.target[axis] - m.position[axis]
                squared += flight[axis] * flight[axis]
            distance = math.sqrt(squared)
            if distance > SAME_PLACE:
                for axis in range(3):
                    flight[axis] /= distance
            else:
                distance = 0.0
                for axis in range(3):
                    m.target[axis] = m.position[axis]
            count = min(max(samples[e, i], 1), c.max_samples)
            duration = flight_time(distance, c.speed, c.acceleration) if distance > 0.0 else 0.0
            begin_leg(m, ledger[e, i], c, clock, flight[0], flight[1], flight[2], distance, duration, count)
            if not c.event_clock:
                complete_leg(m, ledger[e, i], c)
        if c.event_clock:
            advance_to_next(motion, ledger, episode, c, e)
        else:
            wait_for_slowest(motion, ledger, episode, c, e)


@njit(cache=True, error_model="numpy")
def fly_periods(
    motion: StateArray,
    ledger: StateArray,
    episode: StateArray,
    constants: StateArray,
    geometry: Geometry | None,
    stepping: BoolArray,
    commands: FloatArray,
    tracks: bool,
) -> None:
    """One decision period of point masses in every running world.

    `commands` (n_envs, n_uavs, 3) are velocities, m/s, or, if it `tracks`, the places to steer to, m.
    """
    n_envs, n_uavs = motion.shape
    c = constants[0]
    for e in range(n_envs):
        stepping[e] = episode[e].outcome == RUNNING
        if not stepping[e]:
            continue
        for i in range(n_uavs):
            if motion[e, i].active:
                u, v, w = commands[e, i, 0], commands[e, i, 1], commands[e, i, 2]
                fly_period(motion[e, i], ledger[e, i], c, geometry, u, v, w, tracks)
        episode[e].clock += c.decision_period


@njit(cache=True, error_model="numpy")
def mask_blocked_hops(motion: StateArray, geometry: Geometry, offsets: FloatArray, mask: BoolArray) -> None:
    """Clear in `mask` (n_envs, n_uavs, n_hops) the hops, by `offsets` (n_hops, 3) m, that meet an obstacle."""
    for e in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            for k in range(offsets.shape[0]):
                mask[e, i, k] = mask[e, i, k] and is_clear_hop(geometry, motion[e, i].position, offsets, k)
