"""Quadrotor: a rigid body with four rotors under a geometric controller, flown towards places or at velocities.

The controller runs every `control_period` (100 Hz, RotorPy's rate), the body is integrated in steps of `physics_step`
(`rigid_body.py`), and a decision lasts `decision_period`, a whole number of control periods. Far from the place it
steers to, the position controller's steady speed is K_p / K_v times the distance: a set-point farther away than
`lookahead` = speed K_v / K_p is cut to that distance, and so the vehicle flies at its `speed`, less what drag takes.
A velocity is held without an integral: in still air the crazyflie flies at 94 %, the others at 90 % of the commanded.

The default physics step of 10 ms keeps the crazyflie within 2e-6 m of the exact flight, one of 5 ms within 1e-7 m. The
hummingbird's motors (5 ms) are faster than that: it stays within 1 mm, and within 1e-6 m at a step of 1 ms.

`backend: rotorpy` flies RotorPy's own vehicle and controller instead, one UAV at a time, to compare with; `native` is
the batched kernel that gives the same flight.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, model_validator

from osl_env.parameters import quantity
from osl_env.state import StateArray
from osl_env.vehicles.airframe import AIRFRAMES, Airframe
from osl_env.vehicles.base import Vehicle


def _named(name: Any, key: str) -> Airframe:
    if not isinstance(name, str) or name not in AIRFRAMES:
        raise ValueError(f"{key} = {name!r}: allowed are {', '.join(AIRFRAMES)}")
    return AIRFRAMES[name]


def _airframe(value: Any) -> Any:
    """An airframe from its name, or from a mapping: `base` names what its other keys differ from."""
    if isinstance(value, Airframe):
        return value
    if not isinstance(value, dict):
        return _named(value, "airframe")
    if "base" not in value:
        return value
    differences = {key: entry for key, entry in value.items() if key != "base"}
    return _named(value["base"], "airframe.base").model_dump() | differences


def _check_steps(step: float, period: float, step_name: str, period_name: str) -> int:
    """How many steps a period has; ValueError unless that is a whole number."""
    steps = period / step
    if abs(steps - round(steps)) > 1e-9 or steps < 1:
        raise ValueError(f"{step_name} = {step}: must divide {period_name} = {period} s into whole steps")
    return round(steps)


class Quadrotor(Vehicle):
    """Quadrotor with motors, aerodynamics and an SE(3) position controller; takes waypoints, velocities, set-points."""

    commands: ClassVar[tuple[str, ...]] = ("waypoint", "velocity", "setpoint")

    kind: Literal["quadrotor"] = "quadrotor"
    airframe: Annotated[Airframe, BeforeValidator(_airframe)] = AIRFRAMES["crazyflie"]
    backend: Literal["native", "rotorpy"] = "native"
    decision_period: float = quantity(0.05, "s", gt=0)  # of a velocity or a set-point
    control_period: float = quantity(0.01, "s", gt=0)
    physics_step: float = quantity(0.01, "s", gt=0)
    feels_wind: bool = True  # False: it flies as in still air, as the chemotaxis paper's does
    turn_time: float = quantity(0.0, "s", ge=0)  # it flies in any direction without turning first
    arrival_radius: float = quantity(0.25, "m", gt=0)  # within which a way point is reached

    @model_validator(mode="after")
    def _whole_steps(self) -> Quadrotor:
        _check_steps(self.physics_step, self.control_period, "physics_step", "control_period")
        _check_steps(self.control_period, self.decision_period, "control_period", "decision_period")
        return self

    @property
    def lookahead(self) -> float:
        """m, the distance to which a set-point is cut: from it, the controller flies at `speed`."""
        return self.speed * self.airframe.velocity_gain[0] / self.airframe.position_gain[0]

    def numbers(self) -> StateArray:
        """AIRFRAME (1,): what the kernels need of the airframe and of the vehicle."""
        record = self.airframe.numbers()
        for name in ("speed", "lookahead", "arrival_radius", "feels_wind", "control_period", "physics_step"):
            record[name] = getattr(self, name)
        record["physics_steps"] = round(self.control_period / self.physics_step)
        return record
