"""RotorPy's own vehicle and controller behind the state and the commands of a `Quadrotor`: the reference in flight.

RotorPy 3.0.0: `Multirotor` (aerodynamics on, no ground) integrated by scipy's RK45 over each control period with its
default tolerances, under `SE3Control`. One body at a time, about 1.5 ms a control period. The parameters are those of
the airframe, so that an airframe of one's own flies too. Beyond RotorPy's: the gains of the airframe take the place of
those written into `SE3Control`, and towards a velocity the gain of the place is 0. It has no limit of tilt: an
airframe with one is refused.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from osl_env.vehicles.airframe import RIGHT_ANGLE, Airframe
from osl_env.vehicles.quadrotor import Quadrotor

_CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))  # of the X, in RotorPy's order of the rotors


def rotorpy_parameters(airframe: Airframe) -> dict[str, Any]:
    """`airframe` in the terms of RotorPy's `quad_params`."""
    a = airframe.arm_length / math.sqrt(2)
    drag, inertia = airframe.parasitic_drag, airframe.inertia
    return {
        "mass": airframe.mass,
        **dict(zip(("Ixx", "Iyy", "Izz"), inertia, strict=True)),
        **dict.fromkeys(("Ixy", "Iyz", "Ixz"), 0.0),
        "num_rotors": 4,
        "rotor_pos": {f"r{k + 1}": np.array([x * a, y * a, 0.0]) for k, (x, y) in enumerate(_CORNERS)},
        "rotor_directions": np.array([x * y for x, y in _CORNERS]),
        **dict(zip(("c_Dx", "c_Dy", "c_Dz"), drag, strict=True)),
        **{name: getattr(airframe, name) for name in ("k_eta", "k_m", "k_d", "k_z", "k_h", "k_flap")},
        "tau_m": airframe.motor_time_constant,
        "rotor_speed_min": airframe.rotor_speed_min,
        "rotor_speed_max": airframe.rotor_speed_max,
        "motor_noise_std": 0.0,
        "kp_att": airframe.attitude_gain,
        "kd_att": airframe.rate_gain,
    }


class RotorpyBody:
    """RotorPy's vehicle and controller for bodies of one kind. Raises InputError if RotorPy is not installed."""

    def __init__(self, vehicle: Quadrotor, **integrator: Any) -> None:
        """For bodies of kind `vehicle`; `integrator` are arguments of scipy's solve_ivp, RotorPy's by default."""
        try:
            from rotorpy.controllers.quadrotor_control import SE3Control
            from rotorpy.vehicles.multirotor import Multirotor
        except ImportError as error:
            raise InputError(
                f'vehicle.backend = "rotorpy": needs RotorPy ({error}); pip install "osl-env[quadrotor]",'
                ' or use the backend "native"'
            ) from None
        airframe = vehicle.airframe
        if airframe.tilt_limit < RIGHT_ANGLE:
            raise InputError(
                f'vehicle.backend = "rotorpy": its controller has no limit of tilt, and the airframe {airframe.name!r}'
                f" has one of {airframe.tilt_limit:.3g} rad; set its tilt_limit to 180 deg (none) or use native"
            )
        parameters = rotorpy_parameters(airframe)
        options = {"integrator_kwargs": {"method": "RK45", **integrator}} if integrator else {}
        self._multirotor = Multirotor(parameters, **options)
        self._controller = SE3Control(parameters)
        self._gain = np.array(airframe.position_gain)
        self._controller.kd_pos = np.array(airframe.velocity_gain)
        self._period = vehicle.control_period

    def fly_step(self, state: FloatArray, target: FloatArray, tracks_position: bool, wind: FloatArray) -> None:
        """One control period of a body's state (17,), in place.

        `target` (3,) is a place, m, if `tracks_position`, else a velocity, m/s; `wind` (3,) is in m/s. A body whose
        flight has become unstable, which RotorPy cannot integrate, is left with a state that is not finite.
        """
        zero = np.zeros(3)
        self._controller.kp_pos = self._gain if tracks_position else zero
        aim = {
            "x": target if tracks_position else zero,
            "x_dot": zero if tracks_position else target,
            "x_ddot": zero,
            "yaw": 0.0,
            "yaw_dot": 0.0,
        }
        before = {
            "x": state[0:3],
            "v": state[3:6],
            "q": state[6:10],
            "w": state[10:13],
            "wind": wind,
            "rotor_speeds": state[13:17],
        }
        try:
            after = self._multirotor.step(before, self._controller.update(0.0, before, aim), self._period)
        except (ValueError, FloatingPointError, np.linalg.LinAlgError):
            state[:] = np.nan
            return
        state[0:3], state[3:6], state[6:10] = after["x"], after["v"], after["q"]
        state[10:13], state[13:17] = after["w"], after["rotor_speeds"]

    def steer(
        self, state: FloatArray, target: FloatArray, tracks_position: bool, longest: float, wind: FloatArray
    ) -> None:
        """As `fly_step`, with the target cut to `longest`: a place to that distance, m, a velocity to that speed."""
        offset = target - state[:3] if tracks_position else np.asarray(target)
        excess = float(np.linalg.norm(offset)) / longest
        if excess > 1.0:
            offset = offset / excess
            target = state[:3] + offset if tracks_position else offset
        self.fly_step(state, target, tracks_position, wind)
