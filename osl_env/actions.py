"""What a UAV can be told to do, in physical units.

`Hop`, `Waypoint` and `Hover` are legs (turn, fly, hover and sample) for the scenario's actions `hop` and `waypoint`;
`Velocity` and `Setpoint` hold for one decision period. The views (`osl_env.envs`) translate the numbers that learned
agents give into the same commands.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple, TypeAlias

import numpy as np

from osl_env.parameters import FloatArray

# (26, 3): the offsets of a 3D grid's neighbours in lexicographic order, in steps; the direction of a Hop is a row of it
HOP_DIRECTIONS: FloatArray = np.array([step for step in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(step)])
HOP_DIRECTIONS.setflags(write=False)


class Hop(NamedTuple):
    """Fly `length` grid steps towards neighbour `direction` of `HOP_DIRECTIONS`, then hover and sample once."""

    direction: int  # 0 .. 25
    length: int = 1  # grid steps


class Hover(NamedTuple):
    """Stay, and sample for `samples` sampling times."""

    samples: int = 1


class Waypoint(NamedTuple):
    """Fly straight to `position`, then hover and sample for `samples` sampling times."""

    position: FloatArray  # (3,) m
    samples: int = 1


class Velocity(NamedTuple):
    """Fly with `velocity` for one decision period, sampling all the while."""

    velocity: FloatArray  # (3,) m/s


class Setpoint(NamedTuple):
    """Steer to `position` for one decision period, sampling all the while."""

    position: FloatArray  # (3,) m


Action: TypeAlias = Hop | Hover | Waypoint | Velocity | Setpoint
