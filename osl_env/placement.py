"""Where an episode begins: the UAVs' start positions and the sources, fixed or drawn anew from a region.

A team is drawn one by one, each `spacing` away from those before it (random sequential placement); if there is no
place left for one, all are drawn again. At random, a plane fills up at about 70 places in each 100 squares of the
spacing and a line at 75 (Feder, J. Theor. Biol. 87, 1980; Renyi 1958), so a team may have as many UAVs as half of a
lattice of the spacing has points: a place is then found soon.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from pydantic import field_validator, model_validator

from osl_env.arena import Arena
from osl_env.geometry import Geometry, is_taken
from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Parameters, Vector, quantity
from osl_env.state import IntArray
from osl_env.streams import Purpose, derive

_SCENARIO = int(Purpose.SCENARIO)
_TRIES = 1000  # draws of a place before the farthest one found is taken
_MOST_TRIES = 1_000_000  # the same, if none of them was free of obstacles
_MOST_TEAMS = 100  # draws of a whole team
_LATTICE = 32  # points a side, at most, of the lattice that says which share of a region is free
_ROUNDING = 1e-9


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
    spacing: float = quantity(0.0, "m", ge=0)  # the least distance between any two starts; 0: any

    _region_ordered = field_validator("region")(_ordered)

    def check(self, arena: Arena) -> None:
        """Raises ValueError if the starts cannot be `spacing` apart, or drawn so."""
        if self.spacing == 0.0:
            return
        if self.region is not None:
            room = room_for(self.region, self.spacing, arena)
            if self.n_uavs > room:
                corners = [list(corner) for corner in self.region]
                raise ValueError(
                    f"n_uavs = {self.n_uavs}: team.region {corners} holds about {room} at team.spacing ="
                    f" {self.spacing:g} m"
                )
            return
        starts = np.array(self.starts[: self.n_uavs])
        for i in range(1, len(starts)):
            distances = np.linalg.norm(starts[:i] - starts[i], axis=1)
            if distances.min() < self.spacing - _ROUNDING:
                j = int(distances.argmin())
                raise ValueError(
                    f"spacing = {self.spacing:g}: team.starts {j} and {i} are {distances[j]:.3g} m apart; move one"
                )

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


def room_for(region: tuple[Vector, Vector], spacing: float, arena: Arena) -> int:
    """How many UAVs can safely be drawn from `region` (low and high corner, m), `spacing` m apart: half as many as a
    lattice of that spacing has points there, where the arena is free.
    """
    sides = [high - low for low, high in zip(*region, strict=True)]
    points = [math.floor(min(side / spacing * (1.0 + _ROUNDING), 1e9)) + 1 for side in sides]
    axes = [
        np.linspace(low, high, 2 * min(n, _LATTICE) + 1)[1::2] for low, high, n in zip(*region, points, strict=True)
    ]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return max(1, int(math.prod(points) * float(arena.free(places).mean()) / 2.0))


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


@njit(error_model="numpy")
def _draw_team(state: Any, low: Any, high: Any, spacing: float, geometry: Any, starts: Any) -> bool:
    """Draw `starts` (n_uavs, 3) from the box, m, all `spacing` m apart; False if there was no room for them."""
    for _ in range(_MOST_TEAMS):
        apart = True
        for i in range(starts.shape[0]):
            before = starts[: i if spacing > 0.0 else 0]
            state = _draw_place(state, low, high, before, spacing, geometry, starts[i])
            for j in range(before.shape[0]):
                dx, dy = starts[i, 0] - before[j, 0], starts[i, 1] - before[j, 1]
                dz = starts[i, 2] - before[j, 2]
                apart = apart and math.sqrt(dx * dx + dy * dy + dz * dz) >= spacing
            if not apart:
                break
        if apart:
            return True
    return False


@njit(cache=True, error_model="numpy")
def draw_places(
    seeds: IntArray,
    team_region: FloatArray,
    spacing: float,
    source_region: FloatArray,
    minimum_distance: float,
    geometry: Geometry | None,
    starts: FloatArray,
    sources: FloatArray,
) -> bool:
    """Fill in what is random: `starts` (n, n_uavs, 3) and `sources` (n, n_sources, 3), m, of the episodes with `seeds`.

    A region is (2, 3); an empty one (0, 3) leaves the given places. Starts come from stream 0, sources
    from stream 1. What is drawn is free of the obstacles in `geometry` (None: there are none). False: no room was found
    for starts `spacing` m apart.
    """
    for k in range(seeds.size):
        if team_region.shape[0] == 2:
            state = derive(seeds[k], _SCENARIO, 0)
            if not _draw_team(state, team_region[0], team_region[1], spacing, geometry, starts[k]):
                return False
        if source_region.shape[0] == 2:
            state = derive(seeds[k], _SCENARIO, 1)
            for i in range(sources.shape[1]):
                state = _draw_place(
                    state, source_region[0], source_region[1], starts[k], minimum_distance, geometry, sources[k, i]
                )
    return True
