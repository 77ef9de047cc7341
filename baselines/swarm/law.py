"""The control law of swarm plume tracking: what moves a robot, from what it and its radio neighbours sense.

A. Marjovi and L. Marques, "Swarm robotic plume tracking for intermittent and time-variant odor dispersion", European
Conference on Mobile Robots 2013, eqs 1 to 9. Robot i at P_i, with the temporal mean C_i of its concentration:

    goal:      G_i = k1 grad C_i - k2 U_i                                                               (1)
               grad C_i = sum_j (C_j - C_i) / |P_j - P_i| * (P_j - P_i) / |P_j - P_i|                   (2) to (4)
    cohesion:  a neighbour nearer than R1 pushes by mu1 q_j / d^2, one farther than R2 pulls by
               mu2 q_j / d^2, and between them there is none                                            (5), (7)
    odor:      q_j = beta (C_j - C0) / (Cmax - C0), Cmax the largest concentration known so far         (6)
    obstacles: each ray of the range sensors that meets something at d pushes back by c1 / d^n          (8)
    total:     F_i = G_i + cohesion + obstacles                                                         (9)

Read differently: the printed eq 5 has the sign that pulls near robots together and pushes far ones apart, against the
paper's text; `sign` = 1 is the text, -1 the print. q is kept within [0, beta], and is 0 while Cmax is C0. Nothing is
divided by less than `SMALLEST_DISTANCE`. Robots at one place feel no gradient, and part along a direction that their
numbers give, opposite for the two. The functions without an underscore take arrays, for tests and pictures; the
policies' kernel (`steering`) calls the same scalars.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from osl_env.parameters import FloatArray

SMALLEST_DISTANCE = 0.01  # m: anything nearer counts as this near
_ONE_PLACE = 1e-9  # m: no direction
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))  # spreads the directions of pairs at one place


class LawParameters(NamedTuple):
    """The law's numbers. Distances in m; forces are velocities, m/s, and the gains have the units that make them so.

    The defaults are those of the paper's arena of 4 x 6 m.
    """

    gradient_gain: float = 50.0  # k1
    wind_gain: float = 0.5  # k2
    repulsion_gain: float = 1.0  # mu1
    attraction_gain: float = 1.0  # mu2
    repulsion_distance: float = 0.1  # R1, m
    attraction_distance: float = 0.5  # R2, m
    sign: float = 1.0  # of eq 5: 1 as in the text, -1 as printed
    odor_gain: float = 1.0  # beta
    clean_air: float = 0.0  # C0
    obstacle_gain: float = 1.0  # c1
    obstacle_exponent: float = 2.0  # n
    sensor_range: float = 0.15  # m: a ray that reads this has met nothing


PAPER_LAW = LawParameters()


@njit(error_model="numpy")
def _odor_weight(concentration: float, largest: float, law: Any) -> float:
    """q_j, eq 6."""
    span = largest - law.clean_air
    if not span > 0.0:
        return 0.0
    return float(min(max(law.odor_gain * (concentration - law.clean_air) / span, 0.0), law.odor_gain))


@njit(error_model="numpy")
def _pull(distance: float, weight: float, law: Any) -> float:
    """Eq 5 along the way to the neighbour: positive pulls, negative pushes."""
    bounded = max(distance, SMALLEST_DISTANCE)
    if distance < law.repulsion_distance:
        return float(-law.sign * law.repulsion_gain * weight / (bounded * bounded))
    if distance > law.attraction_distance:
        return float(law.sign * law.attraction_gain * weight / (bounded * bounded))
    return 0.0


@njit(error_model="numpy")
def _slope(distance: float, difference: float) -> float:
    """Q_ij, eq 2: the difference of concentration over the distance; 0 at one place."""
    return difference / max(distance, SMALLEST_DISTANCE) if distance > _ONE_PLACE else 0.0


@njit(error_model="numpy")
def _direction(x: float, y: float, z: float, distance: float, own: int, other: int) -> tuple[float, float, float]:
    """The unit vector to a neighbour at the offset (x, y, z); of two at one place it is opposite for the two."""
    if distance > _ONE_PLACE:
        return x / distance, y / distance, z / distance
    angle = _GOLDEN_ANGLE * (own + other)
    side = 1.0 if other > own else -1.0
    return side * math.cos(angle), side * math.sin(angle), 0.0


@njit(error_model="numpy")
def _shove(distance: float, law: Any) -> float:
    """Eq 8, one ray: how much an obstacle at `distance` pushes; a ray that met nothing does not."""
    if not distance < law.sensor_range:
        return 0.0
    return float(law.obstacle_gain / max(distance, SMALLEST_DISTANCE) ** law.obstacle_exponent)


@njit(cache=True, error_model="numpy")
def _weights(concentration: Any, largest: float, law: Any, weight: Any) -> None:
    for k in range(concentration.size):
        weight[k] = _odor_weight(concentration[k], largest, law)


@njit(cache=True, error_model="numpy")
def _cohesion(offset: Any, weight: Any, law: Any, own: int, other: int, force: Any) -> None:
    for k in range(offset.shape[0]):
        x, y, z = offset[k, 0], offset[k, 1], offset[k, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        ux, uy, uz = _direction(x, y, z, distance, own, other)
        pull = _pull(distance, weight[k], law)
        force[k, 0], force[k, 1], force[k, 2] = pull * ux, pull * uy, pull * uz


@njit(cache=True, error_model="numpy")
def _gradient(offset: Any, difference: Any, gradient: Any) -> None:
    for k in range(offset.shape[0]):
        x, y, z = offset[k, 0], offset[k, 1], offset[k, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        ux, uy, uz = _direction(x, y, z, distance, 0, 1)
        slope = _slope(distance, difference[k])
        gradient[0] += slope * ux
        gradient[1] += slope * uy
        gradient[2] += slope * uz


@njit(cache=True, error_model="numpy")
def _obstacles(ranges: Any, law: Any, force: Any) -> None:
    turn = 2.0 * math.pi / max(ranges.shape[0], 1)
    for k in range(ranges.shape[0]):
        push = _shove(ranges[k], law)
        force[0] -= push * math.cos(k * turn)
        force[1] -= push * math.sin(k * turn)


def _array(values: Any, *shape: int) -> FloatArray:
    return np.ascontiguousarray(values, dtype=np.float64).reshape(*shape)


def odor_weight(concentration: Any, largest: float, law: LawParameters = PAPER_LAW) -> FloatArray:
    """Eq 6: q in [0, beta] of robots with `concentration` (...), `largest` being Cmax, in one unit."""
    flat = _array(concentration, -1)
    weight = np.empty_like(flat)
    _weights(flat, float(largest), law, weight)
    return weight.reshape(np.shape(concentration))


def cohesion_force(
    offset: Any, weight: Any, law: LawParameters = PAPER_LAW, *, own: int = 0, other: int = 1
) -> FloatArray:
    """Eq 5: what neighbours at `offset` (..., 3) m from the robot, with odor `weight` q (...), do to it: (..., 3) m/s.

    `own` and `other` are the robots' numbers: they matter only at one place.
    """
    way = np.asarray(offset, dtype=np.float64)
    flat = _array(way, -1, 3)
    force = np.empty_like(flat)
    _cohesion(flat, _array(np.broadcast_to(weight, way.shape[:-1]), -1), law, own, other, force)
    return force.reshape(way.shape)


def gradient(offset: Any, concentration: Any, own: float) -> FloatArray:
    """Eqs 2 to 4: (3,) unit/m, from neighbours at `offset` (n, 3) m with `concentration` (n,); the robot's is `own`."""
    total = np.zeros(3)
    _gradient(_array(offset, -1, 3), _array(concentration, -1) - own, total)
    return total


def goal_vector(offset: Any, concentration: Any, own: float, wind: Any, law: LawParameters = PAPER_LAW) -> FloatArray:
    """Eq 1: (3,) m/s, up the gradient and up the `wind` (3,) m/s; the others as in `gradient`."""
    return law.gradient_gain * gradient(offset, concentration, own) - law.wind_gain * _array(wind, 3)


def obstacle_force(ranges: Any, law: LawParameters = PAPER_LAW) -> FloatArray:
    """Eq 8: (3,) m/s away from what the rays meet; `ranges` (R,) m, evenly spread, the first along +x."""
    force = np.zeros(3)
    _obstacles(_array(ranges, -1), law, force)
    return force


def total_force(
    offset: Any,
    concentration: Any,
    own: float,
    largest: float,
    wind: Any,
    ranges: Any = (),
    law: LawParameters = PAPER_LAW,
) -> FloatArray:
    """Eq 9: (3,) m/s, not yet cut to the vehicle's speed; arguments as above."""
    weight = odor_weight(concentration, largest, law)
    force = goal_vector(offset, concentration, own, wind, law) + obstacle_force(ranges, law)
    force += cohesion_force(_array(offset, -1, 3), weight, law).sum(axis=0)
    return force
