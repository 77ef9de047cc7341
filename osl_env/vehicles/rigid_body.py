"""Rigid body of a quadrotor with four rotors in an X: the equations of RotorPy 3.0.0's `Multirotor`, batched.

    dx/dt = v,   m dv/dt = R F - m g e_z,   dq/dt = q (omega, 0) / 2,   J d(omega)/dt = M - omega x J omega
    d(n_k)/dt = (command_k - n_k) / tau_m                                                    rotor k, at r_k
    F = sum_k (T_k + H_k) - |u| C_D u,   M = sum_k (r_k x (T_k + H_k) + d_k k_m n_k^2 e_z - k_flap n_k u_k x e_z)
    T_k = (k_eta n_k^2 + k_h |u_k,xy|^2) e_z,   H_k = -n_k diag(k_d, k_d, k_z) u_k,   u_k = u + omega x r_k

u = R^T (v - wind) is the airspeed in body axes. Source: Folk, Paulos, Kumar, "RotorPy: A Python-based Multirotor
Simulator with Aerodynamics for Education and Research" (2023), sections II and III. Assumptions: body axes are
principal axes; the rotors 1 to 4 are at (+, +), (+, -), (-, -), (-, +) of r = arm / sqrt 2 and turn so that their
torques are d = (+, -, +, -), by which the sums over rotors have the closed forms below; the wind is constant during a
step; no ground. For constant commands the rotor speeds are known exactly, n(t) = command + (n(0) - command)
exp(-t / tau_m), and enter the classical Runge-Kutta method of fourth order as functions of time: so a motor faster
than the step does not make it unstable.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from osl_env.vehicles.airframe import GRAVITY
from osl_env.vehicles.geometric_control import rotor_commands

STATE_SIZE = 17  # position 0:3, velocity 3:6, attitude x, y, z, w 6:10, body rates 10:13, rotor speeds 13:17
_BODY = 13  # of which all but the rotor speeds are integrated numerically
_STAGE, _RATE, _TOTAL, _COMMANDS = 0, _BODY, 2 * _BODY, 3 * _BODY  # parts of the scratch array
SCRATCH_SIZE = 3 * _BODY + 4
_TOO_FAST = 100.0  # m/s and rad/s: no airframe gets there in controlled flight


@njit(error_model="numpy")
def hover_at(frame: Any, state: Any, x: float, y: float, z: float) -> None:
    """Put a body's state (17,) at rest at (x, y, z), m, level, facing +x, its rotors at the speed of hovering."""
    for i in range(_BODY):
        state[i] = 0.0
    state[0], state[1], state[2], state[9] = x, y, z, 1.0
    for rotor in range(4):
        state[_BODY + rotor] = frame.hover_speed


@njit(inline="always", error_model="numpy")
def _wrench(frame: Any, u: Any, v: Any, w: Any, p: Any, q: Any, r: Any, n1: Any, n2: Any, n3: Any, n4: Any) -> Any:
    """Force, N, and moment, N m, in body axes at airspeed (u, v, w), body rates (p, q, r) and rotor speeds n."""
    a, k_d, k_z, k_h, k_eta = frame.rotor_offset, frame.k_d, frame.k_z, frame.k_h, frame.k_eta
    n, along_x, along_y, crossed = n1 + n2 + n3 + n4, n1 + n2 - n3 - n4, n1 - n2 - n3 + n4, n1 - n2 + n3 - n4
    s1, s2, s3, s4 = n1 * n1, n2 * n2, n3 * n3, n4 * n4
    spin = r * a
    drift_x, drift_y = n * u - spin * along_y, n * v + spin * along_x  # sums of n_k u_k
    air = math.sqrt(u * u + v * v + w * w)
    c_d = frame.parasitic_drag
    fx = -k_d * drift_x - air * c_d[0] * u
    fy = -k_d * drift_y - air * c_d[1] * v
    lift = k_eta * (s1 + s2 + s3 + s4) + 4.0 * k_h * (u * u + v * v + 2.0 * spin * spin)
    fz = lift - k_z * (n * w + a * (p * along_y - q * along_x)) - air * c_d[2] * w
    mx = k_eta * (s1 - s2 - s3 + s4) - 8.0 * k_h * spin * u - k_z * (along_y * w + a * (p * n - q * crossed))
    my = k_eta * (s3 + s4 - s1 - s2) - 8.0 * k_h * spin * v + k_z * (along_x * w + a * (p * crossed - q * n))
    mz = frame.k_m * (s1 - s2 + s3 - s4) - k_d * a * (along_x * v - along_y * u + 2.0 * spin * n)
    return fx, fy, fz, a * mx - frame.k_flap * drift_y, a * my + frame.k_flap * drift_x, mz


@njit(inline="always", error_model="numpy")
def _rates(frame: Any, s: Any, n1: Any, n2: Any, n3: Any, n4: Any, wx: Any, wy: Any, wz: Any, out: Any) -> None:
    """Time derivatives, (13,) in `out`, of the body's part `s` (13,) of the state."""
    qx, qy, qz, qw, p, q, r = s[6], s[7], s[8], s[9], s[10], s[11], s[12]
    two = 2.0 / (qx * qx + qy * qy + qz * qz + qw * qw)  # between steps the quaternion leaves the unit sphere
    xx, yy, zz, xy, xz, yz = two * qx * qx, two * qy * qy, two * qz * qz, two * qx * qy, two * qx * qz, two * qy * qz
    wqx, wqy, wqz = two * qw * qx, two * qw * qy, two * qw * qz
    r00, r01, r02 = 1.0 - yy - zz, xy - wqz, xz + wqy
    r10, r11, r12 = xy + wqz, 1.0 - xx - zz, yz - wqx
    r20, r21, r22 = xz - wqy, yz + wqx, 1.0 - xx - yy
    ax, ay, az = s[3] - wx, s[4] - wy, s[5] - wz
    u, v, w = r00 * ax + r10 * ay + r20 * az, r01 * ax + r11 * ay + r21 * az, r02 * ax + r12 * ay + r22 * az
    fx, fy, fz, mx, my, mz = _wrench(frame, u, v, w, p, q, r, n1, n2, n3, n4)
    per_mass, jx, jy, jz = frame.inverse_mass, frame.inertia[0], frame.inertia[1], frame.inertia[2]
    out[0], out[1], out[2] = s[3], s[4], s[5]
    out[3] = (r00 * fx + r01 * fy + r02 * fz) * per_mass
    out[4] = (r10 * fx + r11 * fy + r12 * fz) * per_mass
    out[5] = (r20 * fx + r21 * fy + r22 * fz) * per_mass - GRAVITY
    out[6] = 0.5 * (qw * p - qz * q + qy * r)
    out[7] = 0.5 * (qz * p + qw * q - qx * r)
    out[8] = 0.5 * (-qy * p + qx * q + qw * r)
    out[9] = -0.5 * (qx * p + qy * q + qz * r)
    out[10] = (mx - (jz - jy) * q * r) * frame.inverse_inertia[0]
    out[11] = (my - (jx - jz) * r * p) * frame.inverse_inertia[1]
    out[12] = (mz - (jy - jx) * p * q) * frame.inverse_inertia[2]


@njit(inline="always", error_model="numpy")
def _clipped(frame: Any, command: float) -> float:
    return float(min(max(command, frame.rotor_speed_min), frame.rotor_speed_max))


@njit(error_model="numpy")
def integrate(frame: Any, state: Any, commands: Any, wx: float, wy: float, wz: float, dt: float, scratch: Any) -> None:
    """Advance a body's state (17,) by `dt` s in the wind (wx, wy, wz), m/s, with constant `commands` (4,), rad/s.

    The commands are cut to what the rotors can do. `scratch` is a float64 array (SCRATCH_SIZE,), overwritten.
    """
    c1, c2 = _clipped(frame, commands[0]), _clipped(frame, commands[1])
    c3, c4 = _clipped(frame, commands[2]), _clipped(frame, commands[3])
    d1, d2, d3, d4 = state[13] - c1, state[14] - c2, state[15] - c3, state[16] - c4
    half = math.exp(-0.5 * dt / frame.motor_time_constant)
    stage, rate, total = scratch[:_BODY], scratch[_RATE:_TOTAL], scratch[_TOTAL:_COMMANDS]
    for i in range(_BODY):
        stage[i], total[i] = state[i], state[i]
    decay = 1.0
    for k in range(4):
        if k == 1:
            decay = half
        elif k == 3:
            decay = half * half
        _rates(frame, stage, c1 + decay * d1, c2 + decay * d2, c3 + decay * d3, c4 + decay * d4, wx, wy, wz, rate)
        share = dt / 6.0 if k == 0 or k == 3 else dt / 3.0
        ahead = dt if k == 2 else 0.5 * dt
        for i in range(_BODY):
            total[i] += share * rate[i]
            stage[i] = state[i] + ahead * rate[i]
    length = math.sqrt(total[6] ** 2 + total[7] ** 2 + total[8] ** 2 + total[9] ** 2)
    for i in range(6, 10):
        total[i] /= length
    for i in range(_BODY):
        state[i] = total[i]
    state[13], state[14], state[15], state[16] = c1 + decay * d1, c2 + decay * d2, c3 + decay * d3, c4 + decay * d4


@njit(error_model="numpy")
def fly_step(
    frame: Any,
    state: Any,
    target_x: float,
    target_y: float,
    target_z: float,
    tracks_position: bool,
    wind_x: float,
    wind_y: float,
    wind_z: float,
    scratch: Any,
) -> None:
    """One control period of a body's state (17,): its controller, then the physics steps of the period.

    The target is a place, m, if `tracks_position`, else a velocity, m/s; the wind is in m/s.
    """
    commands = scratch[_COMMANDS:]
    rotor_commands(frame, state, target_x, target_y, target_z, tracks_position, commands)
    for _ in range(frame.physics_steps):
        integrate(frame, state, commands, wind_x, wind_y, wind_z, frame.physics_step, scratch)


@njit(error_model="numpy")
def has_diverged(state: Any) -> bool:
    """Whether a state (17,) is that of no controlled flight: not finite, faster than 100 m/s, or than 100 rad/s."""
    for i in range(STATE_SIZE):
        if not math.isfinite(state[i]):
            return True
    speed = state[3] * state[3] + state[4] * state[4] + state[5] * state[5]
    spin = state[10] * state[10] + state[11] * state[11] + state[12] * state[12]
    return bool(speed > _TOO_FAST**2 or spin > _TOO_FAST**2)
