"""Where an episode begins: the UAVs' start positions and the sources, fixed or drawn anew from a region."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from pydantic import field_validator, model_validator

from osl_env.geometry import Geometry, is_taken
from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Parameters, Vector, quantity
from osl_env.state import IntArray
from osl_env.streams import Purpose, derive

_SCENARIO = int(Purpose.SCENARIO)
_TRIES = 1000  # draws of a place before the farthest one found is taken
_MOST_TRIES = 1_000_000  # the same, if none of them was free of obstacles


def _ordered(region: tuple[Vector, Vector] | None) -> tuple[Vector, Vector] | None:
    if region is not None and any(low > high for low, high in zip(*region, strict=True)):
        raise ValueError(f"region = {[list(corner) for corner in region]}: the low corner must not exceed the high one")
    return region


class Team(Parameters):
    """The UAVs: how many, and where they start. A `region` draws the starts anew for each episode."""

    n_uavs: int = quantity(3, "", ge=1, le=1024)
    starts: tuple[Vector, ...] = quantity(
        tuple((x, 10.0, 5.0) for x in (10.0, 30.0, 60.0, 20.0, 45.0, 75.0, 5.0, 90.0)), "m"
    )  # of UAV 0, 1, ..; the first n_uavs of them are used
    region: tuple[Vector, Vector] | None = quantity(None, "m")  # low and high corner

    _region_ordered = field_validator("region")(_ordered)

    @model_validator(mode="after")
    def _enough_starts(self) -> Team:
        if self.region is None and self.n_uavs > len(self.starts):
            raise ValueError(
                f"n_uavs = {self.n_uavs}: only {len(self.starts)} starts are given; list more or set region"
            )
        return self


class Sources(Parameters):
    """The gas sources. A `region` draws them anew for each episode, at least `minimum_distance` from every start."""

    positions: tuple[Vector, ...] = quantity(((80.0, 49.8, 21.9),), "m", min_length=1, max_length=64)
    region: tuple[Vector, Vector] | None = quantity(None, "m")  # low and high corner
    number: int = quantity(1, "", ge=1, le=64)  # sources drawn from the region
    minimum_distance: float = quantity(0.0, "m", ge=0)
    strengths: tuple[float, ...] | None = quantity(None, "")  # relative to the plume's; default: 1 each

    _region_ordered = field_validator("region")(_ordered)

    @property
    def count(self) -> int:
        """How many sources each episode has."""
        return self.number if self.region is not None else len(self.positions)

    @model_validator(mode="after")
    def _strength_each(self) -> Sources:
        if self.strengths is not None:
            if len(self.strengths) != self.count:
                raise ValueError(
                    f"strengths = {list(self.strengths)}: must be one number for each of {self.count} sources"
                )
            if min(self.strengths) <= 0:
                raise ValueError(f"strengths = {list(self.strengths)}: every strength must be above 0")
        return self


@njit(cache=True, error_model="numpy")
def _draw_place(state: Any, low: Any, high: Any, away_from: Any, minimum: float, geometry: Any, place: Any) -> Any:
    """Draw `place` (3,) uniformly from the box, `minimum` m away from the points (n, 3): the stream's new state.

    Places that obstacles take are drawn again.
    """
    farthest = -1.0
    candidate = np.empty(3)
    for n in range(_MOST_TRIES):
        for axis in range(3):
            state, u = uniform(state)
            candidate[axis] = low[axis] + u * (high[axis] - low[axis])
        if geometry is not None and is_taken(geometry, candidate[0], candidate[1], candidate[2]):
            continue
        nearest = math.inf
        for k in range(away_from.shape[0]):
            dx, dy = candidate[0] - away_from[k, 0], candidate[1] - away_from[k, 1]
            dz = candidate[2] - away_from[k, 2]
            nearest = min(nearest, math.sqrt(dx * dx + dy * dy + dz * dz))
        if nearest > farthest:
            farthest = nearest
            place[:] = candidate
        if nearest >= minimum or n >= _TRIES - 1:
            break
    return state


@njit(cache=True, error_model="numpy")
def draw_places(
    seeds: IntArray,
    team_region: FloatArray,
    source_region: FloatArray,
    minimum_distance: float,
    geometry: Geometry | None,
    starts: FloatArray,
    sources: FloatArray,
) -> None:
    """Fill in what is random: `starts` (n, n_uavs, 3) and `sources` (n, n_sources, 3), m, of the episodes with `seeds`.

    A region is (2, 3); an empty one (0, 3) leaves the given places. Starts come from stream 0, sources
    from stream 1. What is drawn is free of the obstacles in `geometry` (None: there are none).
    """
    nothing = np.empty((0, 3))
    for k in range(seeds.size):
        if team_region.shape[0] == 2:
            state = derive(seeds[k], _SCENARIO, 0)
            for i in range(starts.shape[1]):
                state = _draw_place(state, team_region[0], team_region[1], nothing, 0.0, geometry, starts[k, i])
        if source_region.shape[0] == 2:
            state = derive(seeds[k], _SCENARIO, 1)
            for i in range(sources.shape[1]):
                state = _draw_place(
                    state, source_region[0], source_region[1], starts[k], minimum_distance, geometry, sources[k, i]
                )
