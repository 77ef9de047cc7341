"""Scenario: the model objects of one task, composed, checked together and hashed.

A scenario is given as a preset's name, a YAML file's path, or a Scenario. A file holds the differences from the
defaults below, or from another preset named by its key `base`.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import ValidationError, model_validator

from osl_env.arena import Arena
from osl_env.configuration import config_folder, merged, read_yaml
from osl_env.energy import EnergyModel
from osl_env.errors import InputError
from osl_env.parameters import Parameters, Vector, one_line, quantity
from osl_env.placement import Sources, Team
from osl_env.plumes.field import FieldPlume
from osl_env.plumes.filament import FilamentPlume
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.plumes.pseudo_gaussian import PseudoGaussianPlume
from osl_env.plumes.puff import GaussianPuffPlume
from osl_env.radio import Radio
from osl_env.reward import Reward
from osl_env.sensors import Anemometer, IdealSensor, MoxSensor, PidSensor, PoissonCounter, RangeSensors, SensorFault
from osl_env.vehicles.grid_hop import GridHop
from osl_env.vehicles.point_mass import PointMass
from osl_env.winds.field import FieldWind
from osl_env.winds.meander import MeanderingWind
from osl_env.winds.series import SeriesWind
from osl_env.winds.turbulence import TurbulentWind
from osl_env.winds.uniform import UniformWind

_MAX_BASES = 8  # a chain of `base` keys longer than this is a loop


Plume: TypeAlias = HitRatePlume | GaussianPuffPlume | FilamentPlume | PseudoGaussianPlume | FieldPlume
AnyWind: TypeAlias = UniformWind | MeanderingWind | TurbulentWind | SeriesWind | FieldWind
AnyVehicle: TypeAlias = GridHop | PointMass
AnyGasSensor: TypeAlias = PoissonCounter | IdealSensor | PidSensor | MoxSensor

_DEFAULT_KINDS = {
    "plume": "hit_rate",
    "advertised_plume": "hit_rate",
    "wind": "uniform",
    "vehicle": "grid_hop",
    "gas_sensor": "poisson_counter",
}
# parameters added after the first hashes were published, with what they mean where they are not given: left out of the
# hash while they have this value, so that a scenario keeps its hash
_ADDED: dict[str, Any] = {
    "range_sensors": RangeSensors().model_dump(mode="json"),
    "sensor_faults": [],
    "arena.obstacles": [],
    "arena.occupancy": None,
    "arena.collision": Arena().collision,
    "arena.clearance": Arena().clearance,
}


class Ending(Parameters):
    """What ends an episode. `declare`: a UAV says where the source is; `reach`: a UAV comes near one."""

    success: Literal["declare", "reach"] = "declare"
    success_radius: float = quantity(5.0, "m", gt=0)  # of the declared position, or of the UAV, from a source
    time_limit: float = quantity(1200.0, "s", gt=0)  # of a UAV's own search time
    max_decisions: int = quantity(800, "", ge=1, le=1_000_000_000)  # kmax, for each UAV


class Scenario(Parameters):
    """One task: everything that an episode is a function of, besides its seed and the actions."""

    name: str = "custom"
    description: str = ""
    arena: Arena = Arena()
    team: Team = Team()
    sources: Sources = Sources()
    plume: Plume = quantity(HitRatePlume(), "", discriminator="kind")
    advertised_plume: Plume | None = quantity(None, "", discriminator="kind")  # what policies are told; else the truth
    wind: AnyWind = quantity(UniformWind(), "", discriminator="kind")
    vehicle: AnyVehicle = quantity(GridHop(), "", discriminator="kind")
    energy: EnergyModel = EnergyModel()
    gas_sensor: AnyGasSensor = quantity(PoissonCounter(), "", discriminator="kind")
    anemometer: Anemometer = Anemometer()
    range_sensors: RangeSensors = RangeSensors()
    sensor_faults: tuple[SensorFault, ...] = ()
    radio: Radio = Radio()
    ending: Ending = Ending()
    reward: Reward = Reward()
    action: Literal["hop", "waypoint", "velocity"] = "hop"
    clock: Literal["barrier", "event"] = "barrier"
    max_neighbours: int = quantity(7, "", ge=0, le=64)  # in an observation: the nearest ones heard

    @model_validator(mode="before")
    @classmethod
    def _default_kinds(cls, values: Any) -> Any:
        """A model without a `kind` is the default one."""
        if isinstance(values, dict):
            for key, kind in _DEFAULT_KINDS.items():
                if isinstance(values.get(key), dict):
                    values = values | {key: {"kind": kind} | values[key]}
        return values

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if self.action not in self.vehicle.commands:
            allowed = ", ".join(self.vehicle.commands)
            raise ValueError(f"action = {self.action!r}: vehicle {self.vehicle.kind!r} takes {allowed}")
        for key, region, places in (
            ("team", self.team.region, self.team.starts[: self.team.n_uavs]),
            ("sources", self.sources.region, self.sources.positions),
        ):
            if region is None:
                self._free("team.starts" if key == "team" else "sources.positions", places)
                continue
            self._inside(f"{key}.region", region)
            if not self.arena.has_room(region):
                raise ValueError(f"{key}.region = {[list(corner) for corner in region]}: all of it is inside obstacles")
        self._far_enough()
        self._smellable()
        _check("plume", self.plume.check, self.arena, self.sources.count)
        _check("wind", self.wind.check, self.arena)
        return self

    def _smellable(self) -> None:
        """The gas sensor must measure what the plume gives, and the policies be told of a plume of what it reports."""
        if self.gas_sensor.measures != self.plume.measures:
            raise ValueError(
                f"gas_sensor.kind = {self.gas_sensor.kind!r}: measures a {self.gas_sensor.measures}, but plume"
                f" {self.plume.kind!r} gives a {self.plume.measures}"
            )
        if self.plume.measures == "concentration" and self.reports == "hits" and self.told_plume.measures != "hit_rate":
            raise ValueError(
                "advertised_plume: gas_sensor.count_unit makes the sensor report hits, so the policies must be told of"
                " a plume of kind hit_rate"
            )
        if self.gas_sensor.measures == "concentration" and self.tick > self.decision_time:
            raise ValueError(
                f"plume.step = {self.tick:g}: must be at most the {self.decision_time:g} s of a sample"
                f" ({'decision_period' if self.action == 'velocity' else 'hover_time'} of the vehicle)"
            )
        if isinstance(self.plume, FieldPlume) and not self._sources_are(self.plume):
            raise ValueError(
                f"sources.positions = {[list(place) for place in self.sources.positions]}: plume 'playback' holds the"
                f" gas of sources at {self.plume.source_positions().tolist()}"
            )
        for k, fault in enumerate(self.sensor_faults):
            if fault.uav is not None and fault.uav >= self.team.n_uavs:
                raise ValueError(f"sensor_faults.{k}.uav = {fault.uav}: there are UAVs 0 to {self.team.n_uavs - 1}")

    def _inside(self, key: str, positions: tuple[Vector, ...]) -> None:
        for position in positions:
            if not self.arena.contains(position):
                box = " x ".join(f"[0, {side:g}]" for side in self.arena.size)
                raise ValueError(f"{key} = {[float(x) for x in position]}: must lie inside the area {box} m")

    def _free(self, key: str, positions: tuple[Vector, ...]) -> None:
        self._inside(key, positions)
        for position in positions:
            if not self.arena.is_free(position):
                raise ValueError(f"{key} = {[float(x) for x in position]}: lies inside an obstacle, or touches one")

    def _far_enough(self) -> None:
        """The source region must hold a place that is `minimum_distance` from every fixed start."""
        if self.sources.region is None or self.team.region is not None:
            return
        corners = [
            (x, y, z)
            for x in _ends(self.sources.region, 0)
            for y in _ends(self.sources.region, 1)
            for z in _ends(self.sources.region, 2)
        ]
        starts = self.team.starts[: self.team.n_uavs]
        reach = max(min(sum((a - b) ** 2 for a, b in zip(c, s, strict=True)) ** 0.5 for s in starts) for c in corners)
        if reach < self.sources.minimum_distance:
            raise ValueError(
                f"sources.minimum_distance = {self.sources.minimum_distance:g}: no corner of sources.region is farther"
                f" than {reach:.3g} m from the starts"
            )

    def _sources_are(self, plume: FieldPlume) -> bool:
        places = plume.source_positions()
        fixed = self.sources.region is None and len(places) == self.sources.count
        return fixed and bool(np.allclose(places, self.sources.positions, atol=1e-6))

    @property
    def told_plume(self) -> Plume:
        """The plume that the policies are told of."""
        return self.plume if self.advertised_plume is None else self.advertised_plume

    @property
    def reports(self) -> Literal["hits", "concentration"]:
        """What a reading is."""
        return self.gas_sensor.reports

    @property
    def n_neighbours(self) -> int:
        """M: entries of the neighbour table of an observation."""
        return min(self.team.n_uavs - 1, self.max_neighbours)

    @property
    def decision_time(self) -> float:
        """The shortest time between two decisions of a UAV, s."""
        if self.action == "velocity" and isinstance(self.vehicle, PointMass):
            return self.vehicle.decision_period
        return self.vehicle.hover_time

    @property
    def tick(self) -> float:
        """s between two updates of air, plume and sensors; 0: nothing changes.

        The plume's own, or the shorter of the wind's and the sensor's.
        """
        if self.plume.tick is not None:
            return float(self.plume.tick)
        ticks = [self.wind.tick] if self.wind.changes else []
        if self.gas_sensor.measures == "concentration":
            ticks.append(float(self.gas_sensor.period))
        return min(ticks, default=0.0)

    @property
    def hash(self) -> str:
        """12 hexadecimal digits that change with anything that changes an episode (not name or description)."""
        content = self.model_dump(mode="json", exclude={"name", "description"})
        for key, default in _ADDED.items():
            _leave_out(content, key.split("."), default)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]

    def override(self, **changes: Any) -> Scenario:
        """This scenario with `changes`: nested mappings or dotted keys (`**{"team.n_uavs": 5}`)."""
        return _build(merged(self.model_dump(), changes), f"scenario {self.name}")


def _ends(region: tuple[Vector, Vector], axis: int) -> tuple[float, float]:
    return region[0][axis], region[1][axis]


def _check(key: str, check: Callable[..., None], *surroundings: Any) -> None:
    """Let a model say whether it fits, and put its key before what it says."""
    try:
        check(*surroundings)
    except ValueError as error:
        raise ValueError(f"{key}.{error}") from None


def _leave_out(content: dict[str, Any], path: list[str], default: Any) -> None:
    """Take the key at `path` out of `content` if it has its `default`."""
    for part in path[:-1]:
        content = content[part]
    if path[-1] in content and content[path[-1]] == default:
        del content[path[-1]]


def _build(content: dict[str, Any], where: str | Path) -> Scenario:
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        raise one_line(error, where) from None


def scenario_names() -> list[str]:
    """The names of the shipped presets."""
    return sorted(path.stem for path in (config_folder() / "scenarios").glob("*.yaml"))


def _find(name: str, beside: Path | None) -> Path:
    shipped = config_folder() / "scenarios" / f"{name}.yaml"
    if "/" not in name and "\\" not in name and shipped.is_file():
        return shipped
    path = Path(name) if beside is None or Path(name).is_absolute() else beside / name
    if path.is_file():
        return path
    if path.suffix in (".yaml", ".yml"):
        raise InputError(f"{path}: no such scenario file")
    near = difflib.get_close_matches(name, scenario_names(), n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise InputError(f"unknown scenario {name!r}: {hint}allowed are {_allowed()}, or a YAML file")


def _allowed() -> str:
    """The presets' names; of a preset and its random variant the first, with a star."""
    names = scenario_names()
    plain = [name for name in names if not name.endswith("-random") or name.removesuffix("-random") not in names]
    starred = [f"{name}*" if f"{name}-random" in names else name for name in plain]
    return f"{', '.join(starred)} (*: also with -random)"


def _content(name: str, beside: Path | None = None, depth: int = 0) -> tuple[dict[str, Any], Path]:
    """The merged content of the scenario file `name` and of the bases that it names, and its path."""
    path = _find(name, beside)
    if depth > _MAX_BASES:
        raise InputError(f"{path}: base: more than {_MAX_BASES} files build on each other; is it a loop?")
    content = {"name": path.stem} | read_yaml(path)
    base = content.pop("base", None)
    if base is None:
        return content, path
    if not isinstance(base, str):
        raise InputError(f"{path}: base = {base!r}: must be the name or path of a scenario")
    return merged(_content(base, path.parent, depth + 1)[0], content), path


def load_scenario(scenario: str | Path | Scenario, **overrides: Any) -> Scenario:
    """The Scenario that `scenario` (a preset's name, a path, or a Scenario) means, with `overrides` laid over it.

    Overrides are nested mappings (`team={"n_uavs": 5}`) or dotted keys (`**{"radio.radius": "20 m"}`). Raises
    InputError for an unknown name, key or unit, or a value out of its limits, in one line.
    """
    if isinstance(scenario, Scenario):
        return scenario.override(**overrides) if overrides else scenario
    if not isinstance(scenario, str | Path):
        raise InputError(f"scenario = {scenario!r:.80}: must be a name, a path or a Scenario")
    content, path = _content(str(scenario))
    where: str | Path = path
    if path.parent == config_folder() / "scenarios":
        where = f"scenario {path.stem}"
    return _build(merged(content, overrides), where)
