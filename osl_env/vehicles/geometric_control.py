"""Geometric controller of a quadrotor on SE(3): from where it should be, or how fast, to four rotor speeds.

    F = m (-K_p (x - x_d) - K_v (v - v_d) + g e_z),   thrust f = F . R e_z
    R_d e_z = F / |F|,   yaw 0,   e_R = (R_d^T R - R^T R_d)^vee / 2
    M = J (-k_R e_R - k_omega omega) + omega x J omega

Source: Lee, Leok, McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)" (CDC 2010), eqs 10, 12, 15 and
16, in the form of RotorPy 3.0.0's `SE3Control`: the gains are divided by mass and inertia, and the references of
acceleration and angular rate are zero. Towards a place the reference of the velocity is zero; towards a velocity, the
term of K_p is left out.

A place far below, or far to the side, asks for a force that points down or nearly sideways: the law above then turns
the vehicle over. An airframe with a `tilt_limit` below pi / 2 keeps the vertical part of F above `least_lift` of the
weight and its horizontal part within the limit, as a maker's flight controller does; RotorPy's controller has none.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

from osl_env.vehicles.airframe import GRAVITY

_NO_FORCE = 1e-9  # N a kg: a force smaller than this has no direction


@njit(inline="always", error_model="numpy")
def _desired_force(frame: Any, s: Any, x: float, y: float, z: float, tracks_position: bool) -> Any:
    """Force a mass, m/s^2, that the position loop asks for; within the airframe's limit of tilt, if it has one."""
    kp, kd = frame.position_gain, frame.velocity_gain
    if tracks_position:
        fx = kp[0] * (x - s[0]) - kd[0] * s[3]
        fy = kp[1] * (y - s[1]) - kd[1] * s[4]
        fz = kp[2] * (z - s[2]) - kd[2] * s[5] + GRAVITY
    else:
        fx, fy, fz = kd[0] * (x - s[3]), kd[1] * (y - s[4]), kd[2] * (z - s[5]) + GRAVITY
    if frame.tilt_tangent > 0.0:
        fz = max(fz, frame.least_lift * GRAVITY)
        excess = math.sqrt(fx * fx + fy * fy) / (fz * frame.tilt_tangent)
        if excess > 1.0:
            fx, fy = fx / excess, fy / excess
    return fx, fy, fz


@njit(inline="always", error_model="numpy")
def _rotor_speed(frame: Any, thrust: float) -> float:
    """Speed, rad/s, of a rotor that gives `thrust` N; negative for a thrust that no rotor gives."""
    return math.copysign(math.sqrt(abs(thrust) / frame.k_eta), thrust)


@njit(error_model="numpy")
def rotor_commands(
    frame: Any,
    state: Any,
    target_x: float,
    target_y: float,
    target_z: float,
    tracks_position: bool,
    commands: Any,
) -> None:
    """Write the rotor speeds `commands` (4,), rad/s, for a body's state (17,).

    The target is a place, m, if `tracks_position`, else a velocity, m/s. A command may lie outside the rotors' limits.
    """
    fx, fy, fz = _desired_force(frame, state, target_x, target_y, target_z, tracks_position)
    qx, qy, qz, qw = state[6], state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    r00, r01, r02 = 1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qy - qz * qw), 2.0 * (qx * qz + qy * qw)
    r10, r11, r12 = 2.0 * (qx * qy + qz * qw), 1.0 - 2.0 * (qx * qx + qz * qz), 2.0 * (qy * qz - qx * qw)
    r20, r21, r22 = 2.0 * (qx * qz - qy * qw), 2.0 * (qy * qz + qx * qw), 1.0 - 2.0 * (qx * qx + qy * qy)
    size, side = math.sqrt(fx * fx + fy * fy + fz * fz), math.sqrt(fy * fy + fz * fz)
    ex, ey, ez = 0.0, 0.0, 0.0
    if side > _NO_FORCE:  # else there is no attitude to turn to: only the rates are damped
        # axes of R_d: b3 = (gx, gy, gz) = F / |F|, b2 = (0, hy, hz) = b3 x e_x / |..|, b1 = b2 x b3 = (side / |F|, ...)
        gx, gy, gz, hy, hz = fx / size, fy / size, fz / size, fz / side, -fy / side
        ix, iy, iz = hy * gz - hz * gy, hz * gx, -hy * gx
        # e_R = half of (b3 . R e_y - b2 . R e_z, b1 . R e_z - b3 . R e_x, b2 . R e_x - b1 . R e_y)
        ex = 0.5 * (gx * r01 + gy * r11 + gz * r21 - hy * r12 - hz * r22)
        ey = 0.5 * (ix * r02 + iy * r12 + iz * r22 - gx * r00 - gy * r10 - gz * r20)
        ez = 0.5 * (hy * r10 + hz * r20 - ix * r01 - iy * r11 - iz * r21)
    jx, jy, jz, k_r, k_w = frame.inertia[0], frame.inertia[1], frame.inertia[2], frame.attitude_gain, frame.rate_gain
    mx = jx * (-k_r * ex - k_w * p) + (jz - jy) * q * r
    my = jy * (-k_r * ey - k_w * q) + (jx - jz) * r * p
    mz = jz * (-k_r * ez - k_w * r) + (jy - jx) * p * q
    quarter = 0.25 * frame.mass * (fx * r02 + fy * r12 + fz * r22)
    roll, pitch = 0.25 * mx / frame.rotor_offset, 0.25 * my / frame.rotor_offset
    yaw = 0.25 * mz * frame.k_eta / frame.k_m
    commands[0] = _rotor_speed(frame, quarter + roll - pitch + yaw)
    commands[1] = _rotor_speed(frame, quarter - roll - pitch - yaw)
    commands[2] = _rotor_speed(frame, quarter - roll + pitch + yaw)
    commands[3] = _rotor_speed(frame, quarter + roll + pitch - yaw)
