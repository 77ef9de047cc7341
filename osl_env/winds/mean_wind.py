"""What winds with a mean velocity share: that velocity, or its speed in a direction drawn for each episode."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import field_validator

from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Vector, quantity
from osl_env.state import IntArray
from osl_env.streams import Purpose, derive
from osl_env.winds.base import Wind

_WIND = int(Purpose.WIND)
MEAN, FLUCTUATION = 0, 2  # indices of the streams of Purpose.WIND; 1 is the start in a field (fields.playback)


@njit(cache=True, error_model="numpy")
def random_directions(seeds: IntArray, speed: float, out: FloatArray) -> None:
    """Horizontal velocities of `speed`, m/s, in the directions of the episodes with `seeds` (n,), into `out` (n, 3)."""
    for k in range(seeds.size):
        _, u = uniform(derive(seeds[k], _WIND, MEAN))
        out[k, 0] = speed * math.cos(2.0 * math.pi * u)
        out[k, 1] = speed * math.sin(2.0 * math.pi * u)
        out[k, 2] = 0.0


class MeanWind(Wind):
    """Base of the winds about a horizontal mean velocity, which may be zero."""

    velocity: Vector = quantity((0.0, -1.0, 0.0), "m/s")  # V, where the air goes; horizontal
    random_direction: bool = False  # keep the speed and draw the direction uniformly for each episode

    @field_validator("velocity")
    @classmethod
    def _horizontal(cls, velocity: Vector) -> Vector:
        if velocity[2] != 0:
            raise ValueError(f"velocity = {list(velocity)}: the wind is horizontal, its z component must be 0")
        return velocity

    @property
    def speed(self) -> float:
        """The mean velocity's magnitude V, m/s."""
        return math.hypot(*self.velocity)

    def draw(self, seeds: IntArray) -> FloatArray:
        """Mean wind velocity (n, 3), m/s, of the episodes with `seeds` (n,)."""
        winds = np.tile(np.array(self.velocity), (len(seeds), 1))
        if self.random_direction and self.speed > 0:
            random_directions(seeds, self.speed, winds)
        return winds
