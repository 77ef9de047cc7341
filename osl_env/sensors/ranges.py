"""Range sensors: how far it is to the nearest obstacle or wall along horizontal rays, with noise.

The rays are spread evenly over the circle, the first along +x. A ray that meets nothing within the sensor's range
reads that range, without noise. Bounds are walls if UAVs are held at them; where crossing them ends a flight, nothing
is there to be seen.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from osl_env.arena import Arena
from osl_env.numerics import normal
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import BoolArray, IntArray
from osl_env.streams import Purpose, derive

_RANGE = int(Purpose.RANGE)


class RangeSensors(Parameters):
    """Range sensors around a UAV. None by default."""

    count: int = quantity(0, "", ge=0, le=64)  # rays
    range: float = quantity(4.0, "m", gt=0)  # the longest distance that is seen
    noise: float = quantity(0.0, "m", ge=0)  # standard deviation of a distance

    def check(self, arena: Arena) -> None:
        """Raises ValueError if there is nothing in the arena that could ever be seen."""
        if self.count and arena.bounds == "end" and not arena.obstructed:
            raise ValueError(
                f"count = {self.count}: there is nothing to see: arena.bounds = 'end' are no walls, and neither"
                " arena.obstacles nor arena.occupancy is given"
            )


@njit(cache=True)
def begin_range_streams(streams: NDArray[np.uint64], rows: IntArray, seeds: IntArray) -> None:
    """Fresh streams (n_envs, n_uavs) in the worlds `rows` for the episodes with `seeds`."""
    for k in range(rows.size):
        for i in range(streams.shape[1]):
            streams[rows[k], i] = derive(seeds[k], _RANGE, i)


@njit(cache=True, error_model="numpy")
def add_range_noise(
    streams: NDArray[np.uint64], looking: BoolArray, noise: float, longest: float, distances: FloatArray
) -> None:
    """Add `noise`, m, to the true `distances` (n_envs, n_uavs, n_rays), m, of the UAVs of `looking` (n_envs, n_uavs).

    Every ray costs a draw, so that what one meets does not change the noise of the others.
    """
    if noise <= 0.0:
        return
    for e in range(streams.shape[0]):
        for i in range(streams.shape[1]):
            for k in range(distances.shape[2] if looking[e, i] else 0):
                streams[e, i], draw = normal(streams[e, i])
                if distances[e, i, k] < longest:
                    distances[e, i, k] = min(max(distances[e, i, k] + noise * draw, 0.0), longest)
