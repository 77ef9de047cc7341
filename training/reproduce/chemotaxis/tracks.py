"""One flight watched at every decision: time, place, the policy's mode and the concentration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines import Policy
from osl_env.parameters import FloatArray
from osl_env.record import EpisodeRecord
from osl_env.world import World
from training.flight import fly
from training.reproduce.chemotaxis.published import PAPER_ORIGIN
from training.sweep import Cell


@dataclass(frozen=True)
class Track:
    """UAV 0's flight, one row a decision, the start first; places in the paper's coordinates."""

    times: FloatArray  # (n,) s
    positions: FloatArray  # (n, 3) m
    readings: FloatArray  # (n,) the sensor's, at these places
    modes: tuple[str, ...]  # (n,) what the policy was doing when it came there
    wind: FloatArray  # (3,) m/s, mean
    threshold: float  # of a detection, in the unit of the readings; 0 for a counter
    record: EpisodeRecord

    @property
    def detected(self) -> NDArray[np.bool_]:
        """(n,) whether the reading is over the threshold."""
        return self.readings > self.threshold

    @property
    def detection_height(self) -> float:
        """m, where the first reading over the threshold was taken; NaN without one."""
        return float(self.positions[np.argmax(self.detected), 2]) if self.detected.any() else math.nan


def in_paper_coordinates(positions: object) -> FloatArray:
    """Our positions (.., 3), m, in the paper's coordinates."""
    return np.asarray(positions, dtype=np.float64) + PAPER_ORIGIN


def fly_track(cell: Cell, seed: int) -> Track:
    """The flight of `cell` with `seed`, flown and watched. Raises InputError as `training.evaluate` does."""
    times: list[float] = []
    positions: list[FloatArray] = []
    readings: list[float] = []
    modes: list[str] = []

    def watch(world: World, team: list[list[Policy]]) -> None:
        times.append(float(world.episode["clock"][0]))
        positions.append(in_paper_coordinates(world.motion["position"][0, 0]))
        readings.append(float(world.senses["reading"][0, 0]))
        modes.append(team[0][0].mode)

    flight = fly(cell.policy, cell.scenario, [seed], watch_team=watch)
    return Track(
        times=np.array(times),
        positions=np.array(positions),
        readings=np.array(readings),
        modes=tuple(modes),
        wind=flight.world.episode["wind"][0].copy(),
        threshold=float(getattr(cell.scenario.gas_sensor, "threshold", 0.0)),
        record=EpisodeRecord.of(flight.world, 0, cell.policy.name),
    )
