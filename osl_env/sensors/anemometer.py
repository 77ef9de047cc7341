"""The wind as a UAV measures it: the air's velocity where it is, with noise on the horizontal components."""

from __future__ import annotations

from typing import Any

from numba import njit

from osl_env.numerics import normal
from osl_env.parameters import Parameters, quantity


class Anemometer(Parameters):
    """Wind sensor: the velocity of the air at the UAV, with Gaussian noise on each horizontal component."""

    noise: float = quantity(0.0, "m/s", ge=0)  # standard deviation


@njit(inline="always", error_model="numpy")
def measure_wind(s: Any, c: Any, u: float, v: float, w: float) -> None:
    """Measure the wind (u, v, w), m/s, at one UAV whose leg (or period) has just ended."""
    s.wind[0] = u
    s.wind[1] = v
    s.wind[2] = w
    if c.wind_noise > 0.0:
        for axis in range(2):
            s.anemometer_stream, noise = normal(s.anemometer_stream)
            s.wind[axis] += c.wind_noise * noise
