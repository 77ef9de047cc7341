"""Electrical power of a quadrotor from the thrust of its rotors: induced, climbing and profile power, and avionics.

    T = 2 rho A v_i sqrt(V^2 + (w + v_i)^2)                        momentum theory, Glauert's for oblique flow
    P = T (kappa v_i + w) + rho A sigma c_d0 / 8 (Omega R)^3 (1 + 4.65 mu^2)           one rotor, at its shaft
    P_electrical = sum of P over the rotors / efficiency + avionics

V and w are the airspeed in the disc's plane and along its axis, v_i the induced velocity, mu = V / (Omega R). Source:
Leishman, "Principles of Helicopter Aerodynamics" (2nd ed., 2006), sections 2.14 and 5.4; 4.65 is Bennett's factor. T w
is the power of climbing, and, as the disc tilts forward, of the body's drag. Assumptions: uniform inflow, rotors that
do not disturb each other, the airspeed of the body's centre at every rotor, no power back from a rotor that windmills.
Descending faster than the induced velocity of hovering, v_h = sqrt(T / (2 rho A)), the rotors are in their own wake and
momentum theory fails: there the power is held at that of descending at v_h. The thrust is that of `rigid_body.py`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from osl_env.energy import ThrustEnergy
from osl_env.vehicles.airframe import Airframe
from osl_env.vehicles.rigid_body import STATE_SIZE, hover_at

_NEWTON_STEPS = 4  # leave an error below 1e-8 of the induced velocity of hovering
_ADVANCE = 4.65  # growth of profile power with the square of the advance ratio


@njit(inline="always", error_model="numpy")
def induced_velocity(hover_squared: float, across: float, along: float) -> float:
    """Induced velocity v_i, m/s, of a rotor with T / (2 rho A) = `hover_squared`, m^2/s^2.

    `across` and `along` are its airspeeds in the disc's plane and along its axis, m/s, climbing positive and no lower
    than -sqrt(`hover_squared`), which must be above 0.
    """
    v = math.sqrt(0.25 * along * along + hover_squared) - 0.5 * along  # the solution for axial flow: never too small
    for _ in range(_NEWTON_STEPS):
        squared = across * across + (along + v) * (along + v)
        flow = math.sqrt(squared)
        v -= flow * (v * flow - hover_squared) / (squared + v * (along + v))
    return v


@njit(inline="always", error_model="numpy")
def _shaft_power(frame: Any, rotors: Any, n: float, across: float, along: float) -> float:
    """Power, W, at the shaft of one rotor that turns at `n` rad/s."""
    area = math.pi * frame.rotor_radius * frame.rotor_radius
    thrust = frame.k_eta * n * n - frame.k_z * n * along + frame.k_h * across * across
    power = 0.0
    if thrust > 0.0 and n > 0.0:  # translational lift alone needs no torque
        hover_squared = thrust / (2.0 * rotors.air_density * area)
        along = max(along, -math.sqrt(hover_squared))
        power = thrust * (rotors.induced_factor * induced_velocity(hover_squared, across, along) + along)
    tip = n * frame.rotor_radius
    drag = rotors.air_density * area * frame.solidity * frame.profile_drag / 8.0
    return float(max(power + drag * tip * (tip * tip + _ADVANCE * across * across), 0.0))


@njit(error_model="numpy")
def electrical_power(frame: Any, rotors: Any, state: Any, wind_x: float, wind_y: float, wind_z: float) -> float:
    """Power, W, drawn from the battery by a body in `state` (17,) in the wind, m/s.

    `frame` is an AIRFRAME record and `rotors` a ROTORS record (`ThrustEnergy.numbers`).
    """
    qx, qy, qz, qw = state[6], state[7], state[8], state[9]
    u, v, w = state[3] - wind_x, state[4] - wind_y, state[5] - wind_z
    x, y, z = 2.0 * (qx * qz + qy * qw), 2.0 * (qy * qz - qx * qw), 1.0 - 2.0 * (qx * qx + qy * qy)
    along = u * x + v * y + w * z
    across = math.sqrt(max(u * u + v * v + w * w - along * along, 0.0))
    shafts = 0.0
    for rotor in range(13, 17):
        shafts += _shaft_power(frame, rotors, state[rotor], across, along)
    efficiency = rotors.efficiency if rotors.efficiency > 0.0 else frame.drive_efficiency
    avionics = rotors.avionics_power if rotors.avionics_power >= 0.0 else frame.avionics_power
    return float(shafts / efficiency + avionics)


@njit(error_model="numpy")
def _power_at_hover(frames: Any, rotors: Any, state: Any) -> float:
    hover_at(frames[0], state, 0.0, 0.0, 0.0)
    return float(electrical_power(frames[0], rotors[0], state, 0.0, 0.0, 0.0))


def hovering_power(airframe: Airframe, energy: ThrustEnergy) -> float:
    """Power, W, that `airframe` draws hovering in still air."""
    return float(_power_at_hover(airframe.numbers(), energy.numbers(), np.zeros(STATE_SIZE)))
