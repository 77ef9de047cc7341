"""Uniform horizontal wind: one velocity everywhere and always, drawn once an episode where its direction is random."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit
from pydantic import field_validator

from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Vector, quantity
from osl_env.state import IntArray
from osl_env.streams import Purpose, derive
from osl_env.winds.base import Wind

_WIND = int(Purpose.WIND)


@njit(cache=True, error_model="numpy")
def _random_directions(seeds: IntArray, speed: float, out: FloatArray) -> None:
    for k in range(seeds.size):
        _, u = uniform(derive(seeds[k], _WIND, 0))
        out[k, 0] = speed * math.cos(2.0 * math.pi * u)
        out[k, 1] = speed * math.sin(2.0 * math.pi * u)


class UniformWind(Wind):
    """Uniform wind. Zero wind is allowed; the rate plume is then isotropic."""

    kind: Literal["uniform"] = "uniform"
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
        """Mean wind speed V, m/s."""
        return math.hypot(*self.velocity)

    def draw(self, seeds: IntArray) -> FloatArray:
        """Wind velocity (n, 3), m/s, of the episodes with `seeds` (n,)."""
        winds = np.tile(np.array(self.velocity), (len(seeds), 1))
        if self.random_direction and self.speed > 0:
            _random_directions(seeds, self.speed, winds)
        return winds
