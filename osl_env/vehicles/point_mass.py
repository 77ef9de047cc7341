"""Point mass: follows velocities and setpoints within limits of speed and acceleration; flies legs from rest to rest.

    dv/dt = clip(v_command - v, |.| <= a dt) / dt,   dx/dt = v        integrated at `physics_step`

A setpoint s is steered to by proportional control, v_command = K (s - x) with the position gain K, anew at every
physics step: the UAV nears it exponentially, with the time constant 1 / K, and at its greatest speed from the distance
speed / K on. As long as K speed <= a it can brake as it must, and does not fly past the setpoint.

At the bounds the position is held and the velocity component across them is lost; or, by the scenario's rule, the UAV
flies on and is lost once it is farther outside than the margin. At an obstacle, by the scenario's rule, the UAV stops;
or slides, losing the component into the surface; or its flight ends. With velocities and setpoints the UAV samples all
the while; the reading is counted over the decision period at the place where the period ends. There are no turning
points, so turning costs nothing beyond the flight. A `planar` vehicle is a robot on the ground: of what is commanded
only the horizontal part counts.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from numba import njit
from pydantic import model_validator

from osl_env.geometry import flight_share
from osl_env.parameters import quantity
from osl_env.state import END, FLYING, HOVERING, LEFT, SLIDE
from osl_env.vehicles.base import Vehicle

HOVERING_SPEED = 0.05  # m/s: below it, the power is that of hovering
SURFACES = 3  # that a UAV can slide along in one physics step: more than three do not meet in a corner


class PointMass(Vehicle):
    """Point mass with limits of speed and acceleration; takes velocities, setpoints, way points and hops."""

    commands: ClassVar[tuple[str, ...]] = ("hop", "waypoint", "velocity", "setpoint")

    kind: Literal["point_mass"] = "point_mass"
    acceleration: float = quantity(2.0, "m/s^2", gt=0)  # a
    decision_period: float = quantity(1.0, "s", gt=0)  # of a velocity or a setpoint
    physics_step: float = quantity(0.1, "s", gt=0)
    position_gain: float = quantity(1.6, "1/s", gt=0)  # K: 0.8 a / v at the defaults, so that it can brake in time
    planar: bool = False  # a robot on the ground: it stays at the height at which it starts, whatever is commanded

    @model_validator(mode="after")
    def _whole_steps(self) -> PointMass:
        steps = self.decision_period / self.physics_step
        if abs(steps - round(steps)) > 1e-9 or steps < 1:
            raise ValueError(
                f"physics_step = {self.physics_step}: must divide decision_period = {self.decision_period} s"
                " into whole steps"
            )
        return self

    @property
    def is_planar(self) -> bool:
        """Whether it stays at the height at which it starts."""
        return self.planar

    @property
    def lookahead(self) -> float:
        """How far away a setpoint is approached at the greatest speed, m."""
        return self.speed / min(self.position_gain, 1.0 / self.physics_step)


@njit(error_model="numpy")
def _fly_among(m: Any, c: Any, geometry: Any, dt: float) -> float:
    """Fly one UAV for `dt` s with its velocity, as far as bounds and obstacles let it: the path flown, m."""
    position, velocity = m.position, m.velocity
    path, share = 0.0, 0.0
    dx, dy, dz = velocity[0] * dt, velocity[1] * dt, velocity[2] * dt
    for _ in range(SURFACES):
        x = _held(position[0] + dx, c, velocity, 0)
        y = _held(position[1] + dy, c, velocity, 1)
        z = _held(position[2] + dz, c, velocity, 2)
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
def _held(x: float, c: Any, velocity: Any, axis: int) -> float:
    """The coordinate, m, held at the bounds where they hold, and where the velocity across them is lost."""
    if c.bounds_end:
        return x
    inside: float = min(max(x, 0.0), c.area[axis])
    if inside != x:
        velocity[axis] = 0.0
    return inside


@njit(inline="always", error_model="numpy")
def _has_left(position: Any, c: Any) -> bool:
    """Whether the place is farther outside the bounds than the margin, along some axis."""
    x, y, z = position[0], position[1], position[2]
    outside = max(-x, x - c.area[0], -y, y - c.area[1], -z, z - c.area[2])
    return bool(outside > c.margin)


@njit(inline="always", error_model="numpy")
def _substep(m: Any, book: Any, c: Any, geometry: Any, u: Any, v: Any, w: Any, dt: Any) -> bool:
    """One physics step of one UAV with the commanded velocity (u, v, w), m/s; False once its flight is over."""
    velocity, position = m.velocity, m.position
    du, dv, dw = u - velocity[0], v - velocity[1], w - velocity[2]
    change = math.sqrt(du * du + dv * dv + dw * dw)
    share = min(1.0, c.acceleration * dt / change) if change > 0.0 else 0.0
    velocity[0] += share * du
    velocity[1] += share * dv
    velocity[2] += share * dw
    speed = math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2])
    flying = speed > HOVERING_SPEED
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
        x = _held(position[axis] + velocity[axis] * dt, c, velocity, axis)
        squared += (x - position[axis]) ** 2
        position[axis] = x
    book.path += math.sqrt(squared)
    return bool(alive)


@njit(inline="always", error_model="numpy")
def _cut(u: float, v: float, w: float, speed: float) -> tuple[float, float, float]:
    """The velocity (u, v, w), m/s, cut to `speed`."""
    excess = math.sqrt(u * u + v * v + w * w) / speed
    if excess > 1.0:
        return u / excess, v / excess, w / excess
    return u, v, w


@njit(error_model="numpy")
def fly_period(
    m: Any, book: Any, c: Any, geometry: Any, u: float, v: float, w: float, tracks_position: bool
) -> None:  # fmt: skip
    """One decision period of one UAV with the command (u, v, w): a place to steer to, m, if `tracks_position`, else a
    velocity, m/s. Either is flown at the greatest speed at most.
    """
    if c.planar:
        w = m.position[2] if tracks_position else 0.0
    x, y, z = u, v, w
    if not tracks_position:
        u, v, w = _cut(u, v, w, c.speed)
    gain = min(c.position_gain, 1.0 / c.physics_step)  # more would carry it past its setpoint within a step
    m.samples = 1
    m.collided = False
    for axis in range(3):
        m.origin[axis] = m.position[axis]
    for _ in range(round(c.decision_period / c.physics_step)):
        if tracks_position:
            p = m.position
            u, v, w = _cut(gain * (x - p[0]), gain * (y - p[1]), gain * (z - p[2]), c.speed)
        goes_on = _substep(m, book, c, geometry, u, v, w, c.physics_step)
        if c.bounds_end and _has_left(m.position, c):
            m.fate = LEFT
            goes_on = False
        if not goes_on:
            m.samples = 0
            break
    book.collisions += 1 if m.collided else 0
    book.decisions += 1
    book.flights += 1
    m.ready = True
