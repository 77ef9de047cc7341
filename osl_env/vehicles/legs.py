"""How legs are flown, on either clock, with the battery that may end them.

A leg is: turn by any angle if its direction differs from the last flight's, fly straight, hover and sample. On the
barrier clock the step ends when the slowest UAV is done and the others wait, hovering; on the event clock it ends
with the next UAV that is done. Flight time with acceleration a and top speed v from rest to rest over d: d / v + v /
a, or 2 sqrt(d / a) if the top speed is not reached; with infinite acceleration d / v. If the battery does not last,
the leg is cut at the moment it is empty. A UAV that is lost (its battery is empty, or it has run into an obstacle where
that ends its flight) takes no more samples.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.actions import HOP_DIRECTIONS
from osl_env.geometry import flight_share
from osl_env.parameters import FloatArray
from osl_env.state import END, FLYING, FLYING_ON, HOVERING, TURNING, WAITING
from osl_env.vehicles.base import Vehicle

_SAME_DIRECTION = 1.0 - 1e-9  # cosine above which a leg needs no turn
SAME_PLACE = 1e-9  # m, legs shorter than this hover
_SAME_TIME = 1e-9  # s, legs that end within this of the clock end together


@njit(inline="always", error_model="numpy")
def is_lost(motion: Any, constants: Any) -> bool:
    """Whether the UAV's flight is over: its battery is empty, it has collided or left the bounds under a rule `end`, or
    its flight has become unstable.
    """
    return bool(motion.exhausted or motion.fate != FLYING_ON or (motion.collided and constants.collision == END))


@njit(inline="always", error_model="numpy")
def flight_time(distance: float, speed: float, acceleration: float) -> float:
    if distance * acceleration >= speed * speed:
        return distance / speed + speed / acceleration
    return 2.0 * math.sqrt(distance / acceleration)


@njit(error_model="numpy")
def _cut_by_battery(motion: Any, remaining: float, constants: Any) -> None:
    """Shorten the leg so that it costs `remaining` J: turn, flight and hover in that order."""
    motion.exhausted = True
    motion.samples = 0
    turn = min(remaining, motion.turns * constants.turn_energy)
    if motion.turns > 0 and constants.turn_energy > 0.0:
        motion.leg_turn *= turn / constants.turn_energy
    remaining -= turn
    flight = motion.leg_flight
    if flight > 0.0 and constants.flying_power > 0.0:
        share = min(1.0, remaining / (flight * constants.flying_power))
        for axis in range(3):
            motion.target[axis] = motion.position[axis] + share * (motion.target[axis] - motion.position[axis])
        motion.leg_flight *= share
        motion.leg_path *= share
        motion.collided = motion.collided and share == 1.0  # else it never gets there
        motion.leg_flying_energy = motion.leg_flight * constants.flying_power
        remaining -= motion.leg_flying_energy
    if constants.hovering_power > 0.0:
        motion.leg_hover = min(motion.leg_hover, max(0.0, remaining / constants.hovering_power))
        motion.leg_hovering_energy = motion.leg_hover * constants.hovering_power


@njit(inline="always", error_model="numpy")
def begin_leg(
    motion: Any,
    ledger: Any,
    constants: Any,
    clock: float,
    x: float,
    y: float,
    z: float,
    distance: float,
    duration: float,
    samples: int,
) -> None:
    """Plan one UAV's leg: `distance` m in `duration` s along the unit vector (x, y, z); 0 m hovers.

    Its end `motion.target` and whether it ends at an obstacle, `motion.collided`, are set before.
    """
    origin, position, heading = motion.origin, motion.position, motion.heading
    origin[0], origin[1], origin[2] = position[0], position[1], position[2]
    motion.turns = 0
    motion.leg_turn = 0.0
    motion.leg_flight = duration
    motion.leg_path = distance
    if distance > 0.0:
        cosine = x * heading[0] + y * heading[1] + z * heading[2]
        has_flown = heading[0] != 0.0 or heading[1] != 0.0 or heading[2] != 0.0
        if has_flown and cosine < _SAME_DIRECTION:
            motion.turns = 1
            motion.leg_turn = constants.turn_time
        heading[0], heading[1], heading[2] = x, y, z
    if motion.collided and constants.collision == END:
        samples = 0
    motion.samples = samples
    motion.leg_hover = samples * constants.hover_time
    motion.leg_flying_energy = motion.leg_flight * constants.flying_power
    motion.leg_hovering_energy = motion.leg_hover * constants.hovering_power
    cost = motion.turns * constants.turn_energy + motion.leg_flying_energy + motion.leg_hovering_energy
    remaining = constants.capacity - ledger.spent
    if cost >= remaining:
        _cut_by_battery(motion, max(remaining, 0.0), constants)
    motion.leg_end = clock + (motion.leg_turn + motion.leg_flight + motion.leg_hover)
    motion.ready = False


@njit(inline="always", error_model="numpy")
def charge_leg(motion: Any, ledger: Any, constants: Any, share: float) -> None:
    """Enter `share` (0 .. 1) of the present leg into the ledger."""
    turning = 0.0
    if motion.turns > 0:
        cut = motion.exhausted and constants.turn_time > 0.0
        begun = motion.leg_turn / constants.turn_time if cut else 1.0
        turning = min(share * constants.turn_energy * begun, max(0.0, constants.capacity - ledger.spent))
    flying = share * motion.leg_flying_energy
    hovering = share * motion.leg_hovering_energy
    ledger.energy[TURNING] += turning
    ledger.energy[FLYING] += flying
    ledger.energy[HOVERING] += hovering
    ledger.spent += turning + flying + hovering
    ledger.turning_time += share * motion.leg_turn
    ledger.flying_time += share * motion.leg_flight
    ledger.hovering_time += share * motion.leg_hover
    ledger.search_time += share * (motion.leg_turn + motion.leg_flight + motion.leg_hover)
    ledger.path += share * motion.leg_path


@njit(inline="always", error_model="numpy")
def complete_leg(motion: Any, ledger: Any, constants: Any) -> None:
    """Carry out the leg that was planned: the UAV is at its end, and decides next."""
    position, target = motion.position, motion.target
    position[0], position[1], position[2] = target[0], target[1], target[2]
    charge_leg(motion, ledger, constants, 1.0)
    ledger.turns += motion.turns
    ledger.flights += 1 if motion.leg_path > 0.0 else 0
    ledger.hovers += 1 if motion.samples > 0 else 0
    ledger.collisions += 1 if motion.collided else 0
    ledger.decisions += 1
    motion.ready = True


@njit(error_model="numpy")
def _wait(motion: Any, ledger: Any, constants: Any, duration: float) -> None:
    """Hover for `duration` s until the slowest UAV is done; the battery may end while waiting."""
    cost = duration * constants.hovering_power
    remaining = constants.capacity - ledger.spent
    if cost >= remaining and cost > 0.0:
        duration *= max(remaining, 0.0) / cost
        cost = max(remaining, 0.0)
        motion.exhausted = True
    ledger.energy[WAITING] += cost
    ledger.spent += cost
    ledger.waiting_time += duration


@njit(inline="always", error_model="numpy")
def wait_for_slowest(motion: Any, ledger: Any, episode: Any, constants: Any, e: int) -> None:
    """Barrier clock: move world `e`'s clock to the end of its longest leg; the others hover until then."""
    clock = 0.0
    for i in range(motion.shape[1]):
        if motion[e, i].active:
            clock = max(clock, motion[e, i].leg_end)
    for i in range(motion.shape[1]):
        m = motion[e, i]
        if m.active:
            _wait(m, ledger[e, i], constants, 0.0 if is_lost(m, constants) else clock - m.leg_end)
    episode[e].clock = clock


@njit(inline="always", error_model="numpy")
def advance_to_next(motion: Any, ledger: Any, episode: Any, constants: Any, e: int) -> None:
    """Event clock: move world `e`'s clock to the next end of a leg, and complete the legs that end then."""
    clock = np.inf
    for i in range(motion.shape[1]):
        if motion[e, i].active:
            clock = min(clock, motion[e, i].leg_end)
    for i in range(motion.shape[1]):
        m = motion[e, i]
        if m.active and not m.ready and m.leg_end <= clock + _SAME_TIME:
            complete_leg(m, ledger[e, i], constants)
    episode[e].clock = clock


def hop_offsets(step_length: float, hop_lengths: int) -> FloatArray:
    """What each hop action moves by, hovering last: (26 l_max + 1, 3) m."""
    steps = np.repeat(HOP_DIRECTIONS * step_length, hop_lengths, axis=0)
    lengths = np.tile(np.arange(1.0, hop_lengths + 1.0), len(HOP_DIRECTIONS))
    return np.concatenate([lengths[:, None] * steps, np.zeros((1, 3))])


def hop_table(vehicle: Vehicle) -> FloatArray:
    """What each hop action means: rows of offset (3), m, unit vector (3), length, m, and flight time, s.

    Shape (26 l_max + 1, 8); the last row hovers. A planar vehicle's hops have no vertical part; straight up is staying.
    """
    offsets = hop_offsets(vehicle.step_length, vehicle.hop_lengths)
    if vehicle.is_planar:
        offsets = offsets * (1.0, 1.0, 0.0)
    table = np.zeros((len(offsets), 8))
    table[:, 0:3] = offsets
    for action in range(len(table) - 1):
        table[action, 6] = math.sqrt(sum(x * x for x in table[action, 0:3].tolist()))
        if table[action, 6] > 0.0:
            table[action, 3:6] = table[action, 0:3] / table[action, 6]
            table[action, 7] = flight_time(table[action, 6], vehicle.speed, vehicle.acceleration)
    return table


@njit(inline="always", error_model="numpy")
def _ends_inside(position: Any, area: Any, table: Any, action: int) -> bool:
    u, v, w = position[0] + table[action, 0], position[1] + table[action, 1], position[2] + table[action, 2]
    return bool((u >= 0.0) & (u <= area[0]) & (v >= 0.0) & (v <= area[1]) & (w >= 0.0) & (w <= area[2]))


@njit(inline="always", error_model="numpy")
def hop_inside(position: Any, area: Any, table: Any, action: int, hop_lengths: int, hover: int) -> int:
    """The hop itself if it ends inside the area, else the longest one in its direction that does, else hovering.

    `table` holds the offsets of `hop_offsets` in its first columns.
    """
    if action >= hover or _ends_inside(position, area, table, action):
        return min(action, hover)
    shortest = action - action % hop_lengths
    for shorter in range(action - 1, shortest - 1, -1):
        if _ends_inside(position, area, table, shorter):
            return shorter
    return hover


@njit(error_model="numpy")
def is_clear_hop(geometry: Any, position: Any, table: Any, action: int) -> bool:
    """Whether the flight of a hop from `position` (3,), m, meets no obstacle."""
    x, y, z = position[0], position[1], position[2]
    u, v, w = x + table[action, 0], y + table[action, 1], z + table[action, 2]
    return bool(flight_share(geometry, x, y, z, u, v, w)[0] >= 1.0)


@njit(error_model="numpy")
def clear_hop(geometry: Any, position: Any, table: Any, action: int, hop_lengths: int, hover: int) -> int:
    """The hop itself if it meets no obstacle, else the longest one in its direction that does not, else hovering."""
    if action >= hover:
        return hover
    shortest = action - action % hop_lengths
    for shorter in range(action, shortest - 1, -1):
        if is_clear_hop(geometry, position, table, shorter):
            return shorter
    return hover
