"""Airframes: the physical parameters and controller gains of three quadrotors, from 30 g to 3.4 kg.

Every airframe is a symmetric X of four rotors with principal body axes (`rigid_body.py` has the equations, and their
symbols). Rotor radius, solidity, profile drag and drive efficiency serve the power alone (`rotor_power.py`).

crazyflie     Bitcraze Crazyflie 2. Mass, inertia, arms, rotors, drag, limits and gains are those of RotorPy 3.0.0
              (Foerster 2015, and Folk et al. 2023 for drag). Radius: its 45 mm propellers. Avionics power (0.24 A at
              4.01 V with the rotors at rest) and drive efficiency (8.07 W at a thrust of 30 g, interpolated) are from
              Bitcraze's thrust stand (wiki.bitcraze.io, "investigations: thrust"). Solidity and profile drag are
              estimates. 250 mAh at 3.7 V (3330 J) then hover for 6.9 minutes; the maker states 7.
hummingbird   AscTec Hummingbird. RotorPy 3.0.0 but for the power: solidity, profile drag, avionics power and efficiency
              are estimates, by which 2.1 Ah at 11.1 V (83.9 kJ) hover for 22 minutes; the maker states up to 20.
matrice-100   The class of the DJI Matrice 100, loaded to 3.4 kg (its limit is 3.6 kg), with which MUC-OSL measured
              470 W of hovering power. From the maker: wheelbase 0.65 m, 13 inch propellers, greatest tilt 35
              degrees. Estimates: inertia (a hub of 2.4 kg and 0.1 m radius, arm ends of 0.25 kg), thrust coefficient
              (C_T = 0.11 of a 13 x 4.5 inch propeller), torque (0.021 m of thrust), drag (0.25 1/s of rotor drag at
              the speed of hovering, a flat plate of 0.04 m^2), loss of thrust in climb (0.75 1/s at the same speed),
              motor time constant, greatest rotor speed (thrust 2.7 times the weight), solidity, profile drag and
              avionics power; efficiency so that hovering costs 468 W. The maker's hovering times with one battery, at
              2.36 to 3.43 kg, follow within 6 %. Gains: chosen here by simulation, well damped (no overshoot above
              1 % of a step).
"""

from __future__ import annotations

import math

import numpy as np
from pydantic import model_validator

from osl_env.parameters import Parameters, Vector, quantity
from osl_env.state import StateArray

GRAVITY = 9.81  # m/s^2
RIGHT_ANGLE = math.pi / 2  # rad; an airframe whose `tilt_limit` is not below it has no limit

_F = np.float64
AIRFRAME = np.dtype(  # (1,): the numbers of a quadrotor that the kernels use
    [
        ("mass", _F),  # kg
        ("inverse_mass", _F),
        ("inertia", _F, (3,)),  # kg m^2
        ("inverse_inertia", _F, (3,)),
        ("rotor_offset", _F),  # m, of a rotor along x and along y
        ("hover_speed", _F),  # rad/s
        ("k_eta", _F),
        ("k_m", _F),
        ("k_d", _F),
        ("k_z", _F),
        ("k_h", _F),
        ("k_flap", _F),
        ("parasitic_drag", _F, (3,)),
        ("motor_time_constant", _F),  # s
        ("rotor_speed_min", _F),  # rad/s
        ("rotor_speed_max", _F),
        ("position_gain", _F, (3,)),
        ("velocity_gain", _F, (3,)),
        ("attitude_gain", _F),
        ("rate_gain", _F),
        ("tilt_tangent", _F),  # 0: no limit
        ("least_lift", _F),
        ("rotor_radius", _F),  # m
        ("solidity", _F),
        ("profile_drag", _F),
        ("drive_efficiency", _F),
        ("avionics_power", _F),  # W
        ("speed", _F),  # m/s
        ("lookahead", _F),  # m
        ("arrival_radius", _F),  # m
        ("feels_wind", _F),  # 1, or 0: flies as in still air
        ("control_period", _F),  # s
        ("physics_step", _F),  # s
        ("physics_steps", np.int64),  # in a control period
    ],
    align=True,
)


class Airframe(Parameters):
    """A quadrotor in X configuration and its controller's gains; `AIRFRAMES` holds those that are known by name."""

    mass: float = quantity(..., "kg", gt=0)  # m
    inertia: Vector = quantity(..., "kg m^2")  # J, about the principal axes x, y, z
    arm_length: float = quantity(..., "m", gt=0)  # from the centre to a rotor

    k_eta: float = quantity(..., "kg m", gt=0)  # thrust a squared rotor speed, N/(rad/s)^2
    k_m: float = quantity(..., "kg m^2", gt=0)  # yaw moment a squared rotor speed, N m/(rad/s)^2
    k_d: float = quantity(0.0, "kg", ge=0)  # rotor drag, N/(rad/s)/(m/s)
    k_z: float = quantity(0.0, "kg", ge=0)  # loss of thrust by axial flow, N/(rad/s)/(m/s)
    k_h: float = quantity(0.0, "kg/m", ge=0)  # translational lift, N/(m/s)^2
    k_flap: float = quantity(0.0, "kg m", ge=0)  # flapping moment, N m/(rad/s)/(m/s)
    parasitic_drag: Vector = quantity((0.0, 0.0, 0.0), "kg/m")  # C_D, along the body axes, N/(m/s)^2

    motor_time_constant: float = quantity(..., "s", gt=0)  # tau_m
    rotor_speed_min: float = quantity(0.0, "rad/s", ge=0)
    rotor_speed_max: float = quantity(..., "rad/s", gt=0)

    position_gain: Vector = quantity((6.5, 6.5, 15.0), "1/s^2")  # K_p, divided by mass; RotorPy's values
    velocity_gain: Vector = quantity((4.0, 4.0, 9.0), "1/s")  # K_v
    attitude_gain: float = quantity(..., "1/s^2", gt=0)  # k_R, divided by inertia
    rate_gain: float = quantity(..., "1/s", gt=0)  # k_omega
    tilt_limit: float = quantity(math.pi, "rad", gt=0, le=math.pi)  # pi: none, as in RotorPy
    least_lift: float = quantity(0.3, "", gt=0, lt=1)  # of the weight; only with a limit of tilt below a right angle

    rotor_radius: float = quantity(..., "m", gt=0)  # R
    solidity: float = quantity(..., "", gt=0, lt=1)  # sigma, blade area a disc area
    profile_drag: float = quantity(..., "", ge=0)  # c_d0, mean drag coefficient of the blades
    drive_efficiency: float = quantity(..., "", gt=0, le=1)  # of motors and their drivers
    avionics_power: float = quantity(0.0, "W", ge=0)

    @model_validator(mode="after")
    def _physical(self) -> Airframe:
        for name in ("inertia", "position_gain", "velocity_gain"):
            if min(getattr(self, name)) <= 0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be above 0")
        if min(self.parasitic_drag) < 0:
            raise ValueError(f"parasitic_drag = {self.parasitic_drag}: must be 0 or above")
        if self.rotor_speed_min >= self.rotor_speed_max:
            raise ValueError(
                f"rotor_speed_min = {self.rotor_speed_min}: must be below rotor_speed_max = {self.rotor_speed_max}"
            )
        if not self.rotor_speed_min <= self.hover_speed <= self.rotor_speed_max:
            raise ValueError(
                f"mass = {self.mass}: hovering needs rotors at {self.hover_speed:.6g} rad/s, and they turn at"
                f" {self.rotor_speed_min:g} to {self.rotor_speed_max:g} rad/s"
            )
        return self

    @property
    def name(self) -> str:
        """Its name in `AIRFRAMES`; "custom" if it is none of them."""
        return next((name for name, known in AIRFRAMES.items() if known == self), "custom")

    @property
    def hover_speed(self) -> float:
        """Rotor speed, rad/s, at which the thrust carries the weight."""
        return math.sqrt(self.mass * GRAVITY / (4 * self.k_eta))

    def numbers(self) -> StateArray:
        """AIRFRAME (1,) with all that the airframe itself knows; speed and steps are the vehicle's to fill in."""
        record = np.zeros(1, AIRFRAME)
        for name in type(self).model_fields:
            if name in AIRFRAME.fields:  # type: ignore[operator]
                record[name] = getattr(self, name)
        record["inverse_mass"] = 1 / self.mass
        record["inverse_inertia"] = 1 / np.array(self.inertia)
        record["rotor_offset"] = self.arm_length / math.sqrt(2)
        record["hover_speed"] = self.hover_speed
        record["tilt_tangent"] = math.tan(self.tilt_limit) if self.tilt_limit < RIGHT_ANGLE else 0.0
        return record


AIRFRAMES: dict[str, Airframe] = {
    "crazyflie": Airframe(
        mass=0.03,
        inertia=(1.43e-5, 1.43e-5, 2.89e-5),
        arm_length=0.043,
        k_eta=2.3e-8,
        k_m=7.8e-10,
        k_d=1.02506e-6,
        k_z=7.553e-7,
        motor_time_constant=0.072,
        rotor_speed_max=2500.0,
        attitude_gain=310.0,
        rate_gain=57.0,
        rotor_radius=0.0225,
        solidity=0.2,
        profile_drag=0.06,
        drive_efficiency=0.314,
        avionics_power=0.96,
    ),
    "hummingbird": Airframe(
        mass=0.5,
        inertia=(3.65e-3, 3.68e-3, 7.03e-3),
        arm_length=0.17,
        k_eta=5.57e-6,
        k_m=1.36e-7,
        k_d=1.19e-4,
        k_z=2.32e-4,
        k_h=3.39e-3,
        parasitic_drag=(5e-3, 5e-3, 1e-2),
        motor_time_constant=0.005,
        rotor_speed_max=1500.0,
        attitude_gain=544.0,
        rate_gain=46.64,
        rotor_radius=0.1,
        solidity=0.11,
        profile_drag=0.03,
        drive_efficiency=0.5,
        avionics_power=4.0,
    ),
    "matrice-100": Airframe(
        mass=3.4,
        inertia=(0.063, 0.063, 0.118),
        arm_length=0.325,
        k_eta=4.05e-5,
        k_m=8.5e-7,
        k_d=4.7e-4,
        k_z=1.4e-3,
        parasitic_drag=(0.025, 0.025, 0.05),
        motor_time_constant=0.05,
        rotor_speed_max=750.0,
        position_gain=(2.5, 2.5, 9.0),
        velocity_gain=(2.5, 2.5, 6.0),
        attitude_gain=40.0,
        rate_gain=10.0,
        tilt_limit=math.radians(35.0),
        rotor_radius=0.165,
        solidity=0.095,
        profile_drag=0.02,
        drive_efficiency=0.64,
        avionics_power=25.0,
    ),
}
