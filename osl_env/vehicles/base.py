"""What a vehicle is: the parameters that say how a UAV carries out a command.

A leg is a turn (if the direction changes), a straight flight, and a hover in which the sensor samples. `GridHop` and
`PointMass` fly legs through the same kernels (`legs.py`), a `Quadrotor` with its body. `PointMass` and `Quadrotor` also
take velocities and setpoints, for a decision period.
"""

from __future__ import annotations

import math
from typing import ClassVar

from osl_env.parameters import Parameters, quantity


class Vehicle(Parameters):
    """Base of the vehicles: what every leg needs to be flown."""

    commands: ClassVar[tuple[str, ...]] = ("hop", "waypoint")  # the actions that it can carry out

    speed: float = quantity(1.0, "m/s", gt=0)  # v, cruise and greatest speed
    step_length: float = quantity(1.0, "m", gt=0)  # of the grid; a hop is 1, sqrt 2 or sqrt 3 of it, times its length
    hop_lengths: int = quantity(1, "", ge=1, le=100)  # l_max: the longest hop, in grid steps
    hover_time: float = quantity(1.0, "s", gt=0)  # t_h, of one hovering point: one sample
    turn_time: float = quantity(1.0, "s", ge=0)  # of one turn, by any angle
    max_samples: int = quantity(20, "", ge=1, le=1_000_000)  # the most samples that one leg may take
    acceleration: float = quantity(float("inf"), "m/s^2", gt=0, infinite=True)

    @property
    def is_planar(self) -> bool:
        """Whether it stays at the height at which it starts."""
        return False

    @property
    def lookahead(self) -> float:
        """m, the distance of a setpoint from which on it is flown to at full speed; infinite without setpoints."""
        return math.inf
