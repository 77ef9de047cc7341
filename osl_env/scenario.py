"""Scenario: the model objects of one task, composed, checked together and hashed. Files: `scenario_files`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import ValidationError, model_validator

from osl_env.arena import Arena
from osl_env.configuration import merged
from osl_env.energy import MeasuredEnergy, ThrustEnergy
from osl_env.faults import UavFaults
from osl_env.fields.references import by_content
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
from osl_env.vehicles.quadrotor import Quadrotor
from osl_env.winds.field import FieldWind
from osl_env.winds.meander import MeanderingWind
from osl_env.winds.series import SeriesWind
from osl_env.winds.turbulence import TurbulentWind
from osl_env.winds.uniform import UniformWind

Plume: TypeAlias = HitRatePlume | GaussianPuffPlume | FilamentPlume | PseudoGaussianPlume | FieldPlume
AnyWind: TypeAlias = UniformWind | MeanderingWind | TurbulentWind | SeriesWind | FieldWind
AnyVehicle: TypeAlias = GridHop | PointMass | Quadrotor
AnyEnergy: TypeAlias = MeasuredEnergy | ThrustEnergy
AnyGasSensor: TypeAlias = PoissonCounter | IdealSensor | PidSensor | MoxSensor

_DEFAULT_KINDS = {
    "plume": "hit_rate",
    "advertised_plume": "hit_rate",
    "wind": "uniform",
    "vehicle": "grid_hop",
    "energy": "measured",
    "gas_sensor": "poisson_counter",
}
# parameters added after the first hashes were published, with what they mean where they are not given: left out of the
# hash while they have this value, so that a scenario keeps its hash
_ADDED: dict[str, Any] = {
    "range_sensors": RangeSensors().model_dump(mode="json"),
    "sensor_faults": [],
    "uav_faults": UavFaults().model_dump(mode="json"),
    "team.spacing": Team().spacing,
    "arena.obstacles": [],
    "arena.occupancy": None,
    "arena.collision": Arena().collision,
    "arena.clearance": Arena().clearance,
    "arena.bounds": Arena().bounds,
    "arena.margin": Arena().margin,
    "vehicle.position_gain": PointMass().position_gain,
    "vehicle.planar": PointMass().planar,
    "energy.kind": MeasuredEnergy().kind,
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
    energy: AnyEnergy = quantity(MeasuredEnergy(), "", discriminator="kind")
    gas_sensor: AnyGasSensor = quantity(PoissonCounter(), "", discriminator="kind")
    anemometer: Anemometer = Anemometer()
    range_sensors: RangeSensors = RangeSensors()
    sensor_faults: tuple[SensorFault, ...] = ()
    uav_faults: UavFaults = UavFaults()
    radio: Radio = Radio()
    ending: Ending = Ending()
    reward: Reward = Reward()
    action: Literal["hop", "waypoint", "velocity", "setpoint"] = "hop"
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
        if isinstance(self.vehicle, Quadrotor) and self.vehicle.backend == "rotorpy" and not self.in_periods:
            raise ValueError(f"action = {self.action!r}: vehicle.backend 'rotorpy' takes velocity, setpoint")
        if isinstance(self.energy, ThrustEnergy) and not isinstance(self.vehicle, Quadrotor):
            raise ValueError(
                f"energy.kind = 'thrust': needs a vehicle of kind quadrotor, for its rotors, not {self.vehicle.kind!r}"
            )
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
        _check("plume", self.plume.check, self.arena, self.sources.count)
        _check("advertised_plume", self.told_plume.check, self.arena, self.sources.count)
        _check("wind", self.wind.check, self.arena)
        _check("team", self.team.check, self.arena)
        _check("range_sensors", self.range_sensors.check, self.arena)
        _check("uav_faults", self.uav_faults.check, self.team.n_uavs)
        self._smellable()
        return self

    def _smellable(self) -> None:
        """The gas sensor must measure what the plume gives, and the policies be told of a plume of what it reports."""
        if self.gas_sensor.measures != self.plume.measures:
            raise ValueError(
                f"gas_sensor.kind = {self.gas_sensor.kind!r}: measures a {self.gas_sensor.measures}, but plume"
                f" {self.plume.kind!r} gives a {self.plume.measures}"
            )
        if self.reports == "hits" and self.told_plume.measures != "hit_rate":
            raise ValueError(
                f"advertised_plume.kind = {self.told_plume.kind!r}: the gas sensor reports hits (a count_unit makes it"
                " do so), so the policies must be told of a plume of kind hit_rate"
            )
        if self.gas_sensor.measures == "concentration" and self.tick > self.decision_time:
            raise ValueError(
                f"{self._tick_key} = {self.tick:g}: must be at most the {self.decision_time:g} s of a sample"
                f" ({'decision_period' if self.in_periods else 'hover_time'} of the vehicle)"
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
    def hears_all(self) -> bool:
        """Whether every frame reaches every UAV at once, in all the episode."""
        return self.radio.reaches_all and not self.uav_faults.silence

    @property
    def n_neighbours(self) -> int:
        """M: entries of the neighbour table of an observation."""
        return min(self.team.n_uavs - 1, self.max_neighbours)

    @property
    def in_periods(self) -> bool:
        """Whether a decision lasts a period of the vehicle's, not a leg."""
        return self.action in ("velocity", "setpoint")

    @property
    def decision_time(self) -> float:
        """The shortest time between two decisions of a UAV, s."""
        if self.in_periods and not isinstance(self.vehicle, GridHop):
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
    def _tick_key(self) -> str:
        """The key that sets `tick`."""
        if self.plume.tick is not None:
            return "plume.step"
        return "wind.step" if self.tick == self.wind.tick else "gas_sensor.period"

    @property
    def hash(self) -> str:
        """12 hexadecimal digits that change with anything that changes an episode (not name or description)."""
        content = self.model_dump(mode="json", exclude={"name", "description"})
        content = by_content(content)
        content["uav_faults"] |= dict.fromkeys(set(content["uav_faults"]) - set(self.uav_faults.rules))  # never strike
        for key, default in _ADDED.items():
            _leave_out(content, key.split("."), default)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]

    def override(self, **changes: Any) -> Scenario:
        """This scenario with `changes`: nested mappings or dotted keys (`**{"team.n_uavs": 5}`)."""
        return build_scenario(merged(self.model_dump(), changes), f"scenario {self.name}")


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


def build_scenario(content: dict[str, Any], where: str | Path) -> Scenario:
    """The scenario of a mapping. Raises InputError in one line that begins with `where`."""
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        raise one_line(error, where) from None
