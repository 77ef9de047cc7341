"""Scenario: the model objects of one task, composed, checked together and hashed.

A scenario is given as a preset's name, a YAML file's path, or a Scenario. A file holds the differences from the
defaults below, or from another preset named by its key `base`.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError, model_validator

from osl_env.arena import Arena
from osl_env.configuration import config_folder, merged, read_yaml
from osl_env.energy import EnergyModel
from osl_env.errors import InputError
from osl_env.parameters import Parameters, Vector, one_line, quantity
from osl_env.placement import Sources, Team
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.radio import Radio
from osl_env.reward import Reward
from osl_env.sensors import Anemometer, PoissonCounter
from osl_env.vehicles.grid_hop import GridHop
from osl_env.vehicles.point_mass import PointMass
from osl_env.winds.uniform import UniformWind

_MAX_BASES = 8  # a chain of `base` keys longer than this is a loop


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
    plume: HitRatePlume = HitRatePlume()
    advertised_plume: HitRatePlume | None = None  # what the policies are told; default: the truth
    wind: UniformWind = UniformWind()
    vehicle: GridHop | PointMass = quantity(GridHop(), "", discriminator="kind")
    energy: EnergyModel = EnergyModel()
    gas_sensor: PoissonCounter = PoissonCounter()
    anemometer: Anemometer = Anemometer()
    radio: Radio = Radio()
    ending: Ending = Ending()
    reward: Reward = Reward()
    action: Literal["hop", "waypoint", "velocity"] = "hop"
    clock: Literal["barrier", "event"] = "barrier"
    max_neighbours: int = quantity(7, "", ge=0, le=64)  # in an observation: the nearest ones heard

    @model_validator(mode="before")
    @classmethod
    def _default_kinds(cls, values: Any) -> Any:
        """A vehicle without a `kind` is the default one."""
        if isinstance(values, dict) and isinstance(values.get("vehicle"), dict):
            values = values | {"vehicle": {"kind": "grid_hop"} | values["vehicle"]}
        return values

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if self.action not in self.vehicle.commands:
            allowed = ", ".join(self.vehicle.commands)
            raise ValueError(f"action = {self.action!r}: vehicle {self.vehicle.kind!r} takes {allowed}")
        if self.team.region is None:
            self._inside("team.starts", self.team.starts[: self.team.n_uavs])
        else:
            self._inside("team.region", self.team.region)
        if self.sources.region is None:
            self._inside("sources.positions", self.sources.positions)
        else:
            self._inside("sources.region", self.sources.region)
            self._far_enough()
        return self

    def _inside(self, key: str, positions: tuple[Vector, ...]) -> None:
        for position in positions:
            if not self.arena.contains(position):
                box = " x ".join(f"[0, {side:g}]" for side in self.arena.size)
                raise ValueError(f"{key} = {[float(x) for x in position]}: must lie inside the area {box} m")

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
    def hash(self) -> str:
        """12 hexadecimal digits that change with anything that changes an episode (not name or description)."""
        content = self.model_dump(mode="json", exclude={"name", "description"})
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]

    def override(self, **changes: Any) -> Scenario:
        """This scenario with `changes`: nested mappings or dotted keys (`**{"team.n_uavs": 5}`)."""
        return _build(merged(self.model_dump(), changes), f"scenario {self.name}")


def _ends(region: tuple[Vector, Vector], axis: int) -> tuple[float, float]:
    return region[0][axis], region[1][axis]


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
    raise InputError(f"unknown scenario {name!r}: {hint}allowed are {', '.join(scenario_names())}, or a YAML file")


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
