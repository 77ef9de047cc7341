"""Moves of filaments among walls: nothing passes one.

A move whose path meets a solid is not made (GADEN); what is left of it is tried axis by axis, so that filaments slide
along walls instead of sticking to them. Paths are checked along their whole length, over the floor where they reflect
there, and from and to places as they are stored, in single precision. An outlet that is met on the way ends a
filament.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.geometry import clear_share, is_outlet, is_solid
from osl_env.plumes.filament_blocks import AGE, CONTENT, X, Y, Z
from osl_env.plumes.filament_noise import BLOCK

REFLECT, ABSORB, OPEN = 0, 1, 2  # what the floor does
_MOVED, _BLOCKED, _LEFT = 0, 1, 2


@njit(error_model="numpy")
def _straight(geometry: Any, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> int:
    """What becomes of a filament on a straight path: it gets there, is stopped by a solid, or leaves by an outlet."""
    share = clear_share(geometry, x0, y0, z0, x1, y1, z1)
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    if geometry.cells.size > 0:
        side = 0.5 * min(geometry.spacing[0], geometry.spacing[1], geometry.spacing[2])
        steps = math.ceil(share * math.sqrt(dx * dx + dy * dy + dz * dz) / side)
        for k in range(1, steps + 1):
            t = share * k / steps
            if is_outlet(geometry, x0 + t * dx, y0 + t * dy, z0 + t * dz):
                return _LEFT
    return _MOVED if share >= 1.0 and not is_solid(geometry, x1, y1, z1) else _BLOCKED


@njit(error_model="numpy")
def _path(geometry: Any, floor: int, x0: float, y0: float, z0: float, x1: float, y1: float, z1: float) -> int:
    """`_straight`, or over the floor at z = 0 if the filament reflects there (`z1` < 0)."""
    reflects = floor == REFLECT and z1 < 0.0
    down = z0 / (z0 - z1) if reflects else 1.0
    outcome = _MOVED
    for leg in range(2 if reflects else 1):  # one call in a loop: compiled once
        if leg == 0:
            x, y, z = x0 + down * (x1 - x0), y0 + down * (y1 - y0), 0.0 if reflects else z1
        else:
            x, y, z = x1, y1, -z1
        outcome = _straight(geometry, x0, y0, z0, x, y, z)
        if outcome != _MOVED:
            break
        x0, y0, z0 = x, y, z
    return outcome


@njit(error_model="numpy")
def move_among_walls(
    bodies: Any, start: int, bounds: Any, geometry: Any, floor: int, max_age: float, move: Any
) -> None:
    """Move the filaments of a block by `move` (3, BLOCK) as far as walls let them; what leaves or is too old ends."""
    for k in range(BLOCK):
        body = bodies[:, start + k]
        if body[CONTENT] == 0.0:
            continue
        x0, y0, z0 = float(body[X]), float(body[Y]), float(body[Z])
        goal_x = float(np.float32(body[X] + move[0, k]))
        goal_y = float(np.float32(body[Y] + move[1, k]))
        goal_z = float(np.float32(body[Z] + move[2, k]))
        outcome = _BLOCKED
        for attempt in range(4):  # the whole move, or else along x, y and z in turn
            x1 = goal_x if attempt <= 1 else x0
            y1 = goal_y if attempt == 0 or attempt == 2 else y0
            z1 = goal_z if attempt == 0 or attempt == 3 else z0
            outcome = _path(geometry, floor, x0, y0, z0, x1, y1, z1)
            if outcome == _MOVED:
                x0, y0, z0 = x1, y1, z1
            if outcome == _LEFT or (attempt == 0 and outcome == _MOVED):
                break
        if floor == REFLECT and z0 < 0.0:
            z0 = -z0
        body[X], body[Y], body[Z] = x0, y0, z0
        inside = bounds[0] <= x0 <= bounds[3] and bounds[1] <= y0 <= bounds[4] and bounds[2] <= z0 <= bounds[5]
        if outcome == _LEFT or not inside or body[AGE] > max_age:
            body[CONTENT] = 0.0
