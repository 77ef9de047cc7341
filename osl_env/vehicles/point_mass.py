"""Point mass: follows velocity commands within limits of speed and acceleration, or flies legs from rest to rest.

    dv/dt = clip(v_command - v, |.| <= a dt) / dt,   dx/dt = v        integrated at `physics_step`

At the bounds the position is held and the velocity component across them is lost. At an obstacle, by the scenario's
rule, the UAV stops; or slides, losing the component into the surface; or its flight ends. In velocity mode the UAV
samples all the while; the reading is counted over the decision period at the place where the period ends. There are
no turning points, so turning costs nothing beyond the flight.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from numba import njit
from pydantic import model_validator

from osl_env.geometry import flight_share
from osl_env.parameters import quantity
from osl_env.state import END, FLYING, HOVERING, SLIDE
from osl_env.vehicles.base import Vehicle

_HOVERING_SPEED = 0.05  # m/s: below it, the power is that of hovering
_SURFACES = 3  # that a UAV can slide along in one physics step: more than three do not meet in a corner


class PointMass(Vehicle):
    """Point mass with limits of speed and acceleration; takes velocities, way points and hops."""

    commands: ClassVar[tuple[str, ...]] = ("hop", "waypoint", "velocity")

    kind: Literal["point_mass"] = "point_mass"
    acceleration: float = quantity(2.0, "m/s^2", gt=0)  # a
    decision_period: float = quantity(1.0, "s", gt=0)  # of a velocity command
    physics_step: float = quantity(0.1, "s", gt=0)

    @model_validator(mode="after")
    def _whole_steps(self) -> PointMass:
        steps = self.decision_period / self.physics_step
        if abs(steps - round(steps)) > 1e-9 or steps < 1:
            raise ValueError(
                f"physics_step = {self.physics_step}: must divide decision_period = {self.decision_period} s"
                " into whole steps"
            )
        return self


@njit(error_model="numpy")
def _fly_among(m: Any, c: Any, geometry: Any, dt: float) -> float:
    """Fly one UAV for `dt` s with its velocity, inside the area, as far as obstacles let it: the path flown, m."""
    position, velocity = m.position, m.velocity
    path, share = 0.0, 0.0
    dx, dy, dz = velocity[0] * dt, velocity[1] * dt, velocity[2] * dt
    for _ in range(_SURFACES):
        x = _inside(position[0] + dx, c.area[0], velocity, 0)
        y = _inside(position[1] + dy, c.area[1], velocity, 1)
        z = _inside(position[2] + dz, c.area[2], velocity, 2)
        share, nx, ny, nz = flight_share(geometry, position[0], position[1], position[2], x, y, z)
        dx, dy, dz = x - position[0], y - position[1], z - position[2]
        path += share * math.sqrt(dx * dx + dy * dy + dz * dz)
        if share >= 1.0:
            position[0], position[1], position[2] = x, y, z
            return path
        position[0] += share * dx
        position[1] += share * dy
        position[2] += share * dz
        m.collided = True
        if c.collision != SLIDE:
            velocity[0] = velocity[1] = velocity[2] = 0.0
            return path
        inwards = min(velocity[0] * nx + velocity[1] * ny + velocity[2] * nz, 0.0)
        velocity[0] -= inwards * nx
        velocity[1] -= inwards * ny
        velocity[2] -= inwards * nz
        rest = 1.0 - share
        inwards = min(dx * nx + dy * ny + dz * nz, 0.0)
        dx, dy, dz = rest * (dx - inwards * nx), rest * (dy - inwards * ny), rest * (dz - inwards * nz)
    return path


@njit(inline="always", error_model="numpy")
def _inside(x: float, side: float, velocity: Any, axis: int) -> float:
    """The coordinate held at the bounds 0 and `side`, m, where the velocity across them is lost."""
    inside = min(max(x, 0.0), side)
    if inside != x:
        velocity[axis] = 0.0
    return inside


@njit(inline="always", error_model="numpy")
def _substep(m: Any, book: Any, c: Any, geometry: Any, u: Any, v: Any, w: Any, dt: Any) -> bool:
    """One physics step of one UAV towards velocity (u, v, w), m/s; False once its flight is over."""
    velocity, position = m.velocity, m.position
    du, dv, dw = u - velocity[0], v - velocity[1], w - velocity[2]
    change = math.sqrt(du * du + dv * dv + dw * dw)
    share = min(1.0, c.acceleration * dt / change) if change > 0.0 else 0.0
    velocity[0] += share * du
    velocity[1] += share * dv
    velocity[2] += share * dw
    speed = math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2])
    flying = speed > _HOVERING_SPEED
    power = c.flying_power if flying else c.hovering_power
    remaining = c.capacity - book.spent
    alive = power * dt < remaining
    if not alive:
        dt = max(remaining, 0.0) / power if power > 0.0 else 0.0
        m.exhausted = True
    book.energy[FLYING if flying else HOVERING] += power * dt
    book.spent += power * dt
    book.search_time += dt
    if flying:
        book.flying_time += dt
    else:
        book.hovering_time += dt
    if geometry is not None:
        book.path += _fly_among(m, c, geometry, dt)
        return bool(alive and not (m.collided and c.collision == END))
    squared = 0.0
    for axis in range(3):
        x = position[axis] + velocity[axis] * dt
        inside = min(max(x, 0.0), c.area[axis])
        if inside != x:
            velocity[axis] = 0.0
        squared += (inside - position[axis]) ** 2
        position[axis] = inside
    book.path += math.sqrt(squared)
    return bool(alive)


@njit(error_model="numpy")
def fly_period(m: Any, book: Any, c: Any, geometry: Any, u: float, v: float, w: float) -> None:
    """One decision period of one UAV with the commanded velocity (u, v, w), m/s, cut to the greatest speed."""
    excess = math.sqrt(u * u + v * v + w * w) / c.speed
    if excess > 1.0:
        u, v, w = u / excess, v / excess, w / excess
    m.samples = 1
    m.collided = False
    for axis in range(3):
        m.origin[axis] = m.position[axis]
    for _ in range(round(c.decision_period / c.physics_step)):
        if not _substep(m, book, c, geometry, u, v, w, c.physics_step):
            m.samples = 0
            break
    book.collisions += 1 if m.collided else 0
    book.decisions += 1
    book.flights += 1
    m.ready = True
