"""A flight of a swarm watched: everybody's track, and the plume and the wind at moments evenly spread over it.

How long a flight lasts is known at its end: whenever there are too many moments, every second one is dropped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from osl_env.record import EpisodeRecord
from osl_env.world import World
from training.flight import fly
from training.sweep import Cell

_FEWEST = 40  # moments kept, if the flight has as many decisions; less than twice as many
_SHADES = 160  # along the longer side
_ARROWS = 16


@dataclass(frozen=True)
class Moment:
    """What is around the robots at one time."""

    step: int  # of the tracks
    plume: NDArray[np.float32]  # (n_y, n_x), the plume's unit, at the robots' height
    wind: FloatArray  # (m_y, m_x, 2) m/s


@dataclass(frozen=True)
class Film:
    """A flight in the horizontal plane of the robots' height."""

    cell: Cell
    record: EpisodeRecord
    times: FloatArray  # (n,) s, a row a decision, the start first
    tracks: FloatArray  # (n, n_robots, 2) m
    moments: tuple[Moment, ...]
    source: FloatArray  # (3,) m
    geometry: Geometry
    size: tuple[float, float]  # m
    wind_places: FloatArray  # (m_y, m_x, 3) m


class _Recorder:
    def __init__(self) -> None:
        self.times: list[float] = []
        self.tracks: list[FloatArray] = []
        self.moments: list[Moment] = []
        self.every = 1
        self.plume_places = self.wind_places = np.empty((0, 0, 3))

    def watch(self, world: World) -> None:
        if not self.times:
            size, height = world.scenario.arena.size, float(world.motion["position"][0, 0, 2])
            self.plume_places, self.wind_places = (_grid(size, height, longest) for longest in (_SHADES, _ARROWS))
        self.times.append(float(world.episode["clock"][0]))
        self.tracks.append(world.motion["position"][0, :, :2].copy())
        if (len(self.times) - 1) % self.every == 0:
            self.moments.append(self.moment(world))
            if len(self.moments) >= 2 * _FEWEST:
                self.moments, self.every = self.moments[::2], 2 * self.every

    def moment(self, world: World) -> Moment:
        plume = world.concentration(0, self.plume_places).astype(np.float32)
        wind = world.wind_at(0, self.wind_places)[..., :2]
        return Moment(len(self.times) - 1, plume, wind.copy())


def film(cell: Cell) -> Film:
    """The flight of `cell` with its first seed. Raises InputError as `training.evaluate` does."""
    recorder = _Recorder()
    flight = fly(cell.policy, cell.scenario, cell.seeds[:1], watch=recorder.watch)
    world = flight.world
    if recorder.moments[-1].step < len(recorder.times) - 1:
        recorder.moments.append(recorder.moment(world))
    return Film(
        cell=cell,
        record=EpisodeRecord.of(world, 0, cell.policy.name),
        times=np.array(recorder.times),
        tracks=np.array(recorder.tracks),
        moments=tuple(recorder.moments),
        source=world.source_position[0, 0].copy(),
        geometry=cell.scenario.arena.geometry,
        size=(float(cell.scenario.arena.size[0]), float(cell.scenario.arena.size[1])),
        wind_places=recorder.wind_places,
    )


def _grid(size: tuple[float, ...], height: float, longest: int) -> FloatArray:
    """(n_y, n_x, 3) m, the centres of about square cells, `longest` along the longer side."""
    n_x, n_y = (max(1, round(longest * side / max(size[:2]))) for side in size[:2])
    x, y = np.meshgrid(size[0] * (np.arange(n_x) + 0.5) / n_x, size[1] * (np.arange(n_y) + 0.5) / n_y)
    return np.stack([x, y, np.full_like(x, height)], axis=-1)
