"""What `osl plume` shows, measures and exports: the plume of a scenario as it is simulated, or a field that is played.

Both give readings and winds at places as time goes on. A simulated one is world 0 of a World without anybody flying.
"""

from __future__ import annotations

import difflib
import math
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from osl_env.air import local_winds
from osl_env.errors import InputError
from osl_env.fields import Field, field_names, load_field
from osl_env.geometry import SOLID, Geometry, open_air
from osl_env.parameters import FloatArray
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario, scenario_names
from osl_env.world import World

_SLOWEST = 0.2  # m/s: winds below it are taken to be so fast where a time is chosen
_SHORTEST, _LONGEST = 20.0, 600.0  # s, of a time chosen


class Subject(ABC):
    """A plume or a wind in a box, going on in time."""

    name: str
    quantity: str  # what `readings` gives: "mean hit rate", "concentration" or, without gas, "wind speed"
    unit: str
    low: FloatArray  # (3,) m, corners of the box
    high: FloatArray
    sources: FloatArray  # (n, 3) m
    starts: FloatArray  # (n_uavs, 3) m
    wind: FloatArray  # (3,) m/s, the mean
    uniform_wind: bool
    geometry: Geometry
    changes: bool  # whether time matters
    time: float  # s

    @property
    def centre(self) -> FloatArray:
        """(3,) m: the first source, or the middle of the box."""
        return self.sources[0] if len(self.sources) else (self.low + self.high) / 2

    @property
    def downwind(self) -> FloatArray:
        """(3,): the horizontal unit vector along the mean wind; +x without one."""
        speed = math.hypot(self.wind[0], self.wind[1])
        return np.array([1.0, 0.0, 0.0]) if speed < 1e-9 else np.array([self.wind[0], self.wind[1], 0.0]) / speed

    @property
    def crossing_time(self) -> float:
        """s in which the wind crosses the box one and a half times, within reason."""
        longest = float((self.high - self.low)[:2].max())
        return float(np.clip(1.5 * longest / max(float(np.linalg.norm(self.wind)), _SLOWEST), _SHORTEST, _LONGEST))

    @property
    def development(self) -> float:
        """s after which the plume is there: 0 where it has developed before the episode."""
        return 0.0

    @property
    def threshold(self) -> float | None:
        """The reading above which the gas sensor detects, if there is one."""
        return None

    @abstractmethod
    def readings(self, points: FloatArray) -> FloatArray:
        """The present reading at `points` (.., 3) m; shape (..)."""

    @abstractmethod
    def winds(self, points: FloatArray) -> FloatArray:
        """The present wind (.., 3), m/s, at `points` (.., 3) m."""

    @abstractmethod
    def go_on(self, seconds: float) -> None:
        """Let `seconds` pass."""

    def solid(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which of `points` (.., 3) m lie in obstacles; shape (..)."""
        x, y, z = np.moveaxis(points, -1, 0)
        inside = np.zeros(x.shape, np.bool_)
        geometry = self.geometry
        for low_x, low_y, low_z, high_x, high_y, high_z in geometry.boxes:
            inside |= (low_x <= x) & (x <= high_x) & (low_y <= y) & (y <= high_y) & (low_z <= z) & (z <= high_z)
        for centre_x, centre_y, radius, bottom, top in geometry.cylinders:
            inside |= ((x - centre_x) ** 2 + (y - centre_y) ** 2 <= radius**2) & (bottom <= z) & (z <= top)
        if geometry.cells.size:
            cell = np.floor((points - geometry.origin) / geometry.spacing).astype(np.int64)
            within = np.all((cell >= 0) & (cell < geometry.cells.shape), axis=-1)
            kept = np.where(within[..., None], cell, 0)
            inside |= within & (geometry.cells[kept[..., 0], kept[..., 1], kept[..., 2]] == SOLID)
        return inside


class SimulatedPlume(Subject):
    """The plume of a scenario in the episode with a seed."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        """Begin the episode."""
        self.world = World(scenario)
        self.world.reset([seed])
        self.name, self.unit, self.time = scenario.name, scenario.plume.unit, 0.0
        self.quantity = "mean hit rate" if scenario.plume.measures == "hit_rate" else "concentration"
        self.low, self.high = np.zeros(3), np.array(scenario.arena.size)
        self.sources = self.world.source_position[0].copy()
        self.starts = self.world.motion["position"][0].copy()
        self.wind = scenario.wind.draw(np.array([seed]))[0]
        self.uniform_wind = scenario.wind.uniform
        self.geometry = scenario.arena.geometry
        self.changes = scenario.wind.changes or scenario.plume.tick is not None

    @property
    def development(self) -> float:
        """s after which the plume is there."""
        grows = self.world.scenario.plume.tick is not None and self.world.scenario.plume.lead_time == 0
        return self.crossing_time if grows else 0.0

    @property
    def threshold(self) -> float | None:
        """The gas sensor's, if it measures concentrations and has one."""
        level = float(getattr(self.world.scenario.gas_sensor, "threshold", 0.0))
        return level if level > 0 and self.quantity == "concentration" else None

    def readings(self, points: FloatArray) -> FloatArray:
        """The plume's present reading at `points` (.., 3) m."""
        return self.world.concentration(0, points)

    def winds(self, points: FloatArray) -> FloatArray:
        """The air's present velocity at `points` (.., 3) m."""
        out = np.empty((1, points.size // 3, 3))
        local_winds(self.world.surroundings.scene.air, np.ascontiguousarray(points).reshape(1, -1, 3), out)
        return out.reshape(points.shape)

    def go_on(self, seconds: float) -> None:
        """Let air and plume go on."""
        self.world.run_air(seconds)
        self.time += seconds


class RecordedField(Subject):
    """A field, played in a loop."""

    def __init__(self, field: Field, name: str) -> None:
        """Begin with the first frame."""
        self.field, self.name, self.time = field, name, 0.0
        self.has_gas = field.concentration is not None
        self.quantity, self.unit = ("concentration", field.unit) if self.has_gas else ("wind speed", "m/s")
        self.low, self.high = field.low, field.high
        self.sources, self.starts = field.sources, np.empty((0, 3))
        self.wind, self.uniform_wind = _mean_wind(field), False
        self.geometry = open_air()._replace(cells=field.cells, origin=field.low, spacing=field.spacing)
        self.changes = field.n_frames > 1

    @property
    def crossing_time(self) -> float:
        """s that the field lasts, within reason."""
        return float(np.clip(self.field.loop_period, 1.0, _LONGEST))

    def readings(self, points: FloatArray) -> FloatArray:
        """The concentration at `points` (.., 3) m, or the wind's speed where the field has no gas."""
        if self.has_gas:
            return self.field.at("concentration", points, self.time)
        return np.asarray(np.linalg.norm(self.winds(points), axis=-1))

    def winds(self, points: FloatArray) -> FloatArray:
        """The wind at `points` (.., 3) m; none where the field has gas alone."""
        return np.zeros_like(points) if self.field.wind is None else self.field.at("wind", points, self.time)

    def go_on(self, seconds: float) -> None:
        """Play on."""
        self.time += seconds


def _mean_wind(field: Field) -> FloatArray:
    """(3,) m/s: over the frames and the cells that hold air; 0 without a wind."""
    if field.wind is None or not field.free.any():
        return np.zeros(3)
    return np.asarray(np.mean([frame[field.free].mean(axis=0, dtype=np.float64) for frame in field.wind], axis=0))


def find_field(name: str) -> Field | None:
    """The field that `name` means: a path of an .npz file, or a shipped field's name with .npz behind it or not."""
    path = Path(name)
    if path.suffix == ".npz":
        shipped = str(path.parent) == "." and not path.exists() and path.stem in field_names()
        return load_field(path.stem if shipped else name)
    return load_field(name) if name in field_names() else None


def find_subject(name: str, seed: int, changes: dict[str, Any] | None = None) -> Subject:
    """The plume of the scenario `name` with `changes`, or else the field. Raises InputError if there is neither."""
    known = scenario_names()
    if name in known or Path(name).suffix in (".yaml", ".yml"):
        return SimulatedPlume(load_scenario(name, **(changes or {})), seed)
    field = find_field(name)
    if field is not None:
        if changes:
            raise InputError(f"--set {next(iter(changes))}: {name} is a field, which has nothing to change")
        return RecordedField(field, Path(name).stem)
    near = difflib.get_close_matches(name, [*known, *field_names()], n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(
        f"unknown plume {name!r:.80}: {hint}allowed are the names of `osl list scenarios` and `osl list fields`,"
        " a scenario's YAML file or a field's .npz file"
    )
