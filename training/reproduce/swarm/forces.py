"""The law's forces, pictured and checked against what the paper says of them; nothing flies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Group as Lines
from rich.console import RenderableType
from rich.text import Text

from baselines import Briefing
from baselines.swarm.law import LawParameters, goal_vector
from baselines.swarm.policy import Swarm
from osl_env.parameters import FloatArray
from osl_env.scenario_files import load_scenario
from osl_env.world import World
from training.figures import save
from training.records import write_table, write_text
from training.reproduce.claims import Finding
from training.reproduce.report import ExperimentReport, verdict_lines
from training.reproduce.swarm import force_checks as checks
from training.reproduce.swarm.force_pictures import (
    Goal,
    cohesion_field,
    cohesion_over_distance,
    goal_vectors,
    obstacle_field,
)
from training.reproduce.swarm.readings import REMARKS
from training.store import Store

_SMALL, _LARGE = "arena-4x6-10", "arena-30x40"
_TITLES = {_SMALL: "4 x 6 m", _LARGE: "30 x 40 m"}
_HEIGHT = 0.1  # m
_SPACING = 0.05  # m, of the arrows of the obstacle force
_FACE_DISTANCE = 0.08  # m from a face: nearer than half of the gaps between obstacles
_APPROACH = np.geomspace(0.02, 0.1, 9)  # m: slanting rays still meet the face within the sensor's range
_ROBOTS = np.array([[0.0, 0.0], [0.62, 0.18], [0.25, 0.7]])  # m, of the picture of the cohesion
_WEIGHTS = np.array([1.0, 0.5, 0.1])
_SWARM_CENTRE, _SWARM_RADIUS, _N_ROBOTS = np.array([2.9, 1.55]), 0.9, 15  # of the picture of the goal vector
_MEAN_TIME, _SAMPLE = 15.0, 0.5  # s: three filter times are sampled
_PLUME_CELLS = (180, 120)


@dataclass(frozen=True)
class Forces:
    """Pictures and checks of the law, with the parameters that the policy has in the arenas."""

    name: str = "forces"
    title: str = "Swarm, the forces of the law"
    summary: str = "Eqs 1 to 8 as the robots fly them, in pictures, and checked against the paper's description."

    def run(
        self,
        *,
        episodes: int | None = None,
        quick: bool = False,
        first_seed: int | None = None,
        n_jobs: int | None = None,
        store: Store | None = None,
        progress: bool | None = None,
    ) -> ForceReport:
        """Check; of the arguments only `first_seed` counts, as the plume's."""
        laws = {name: _law(name) for name in (_SMALL, _LARGE)}
        law, delta_d = laws[_SMALL]
        beside, normals = _beside_faces(law)
        approach, normal = _approach(law)
        findings = [
            *(checks.zones(*one, _TITLES[name]) for name, one in laws.items()),
            checks.printed_zones(law),
            checks.proportional(law),
            checks.away_from_obstacles(beside, normals),
            checks.obstacle_decay(approach, normal, _APPROACH, law),
            checks.uphill(law, delta_d),
        ]
        return ForceReport(self, laws, findings, 0 if first_seed is None else first_seed)


@dataclass(frozen=True)
class ForceReport(ExperimentReport):
    """The checks' findings, and the pictures."""

    experiment: Forces
    laws: dict[str, tuple[LawParameters, float]]  # scenario -> the law and delta_d, m
    findings: Sequence[Finding]
    seed: int

    @property
    def remarks(self) -> str:
        """What is read differently."""
        return REMARKS

    @property
    def footnotes(self) -> str:
        """What the pictures show."""
        return (
            "cohesion.png: the force between two robots over their distance. cohesion_field.png: what three robots do "
            "to another one. obstacles.png: eq 8 by the range sensors. goal.png: eq 1 in a plume. Arrows show "
            "directions."
        )

    def tables(self) -> RenderableType:
        """Nothing but the findings."""
        return Lines(Text())

    def rows(self) -> list[dict[str, Any]]:
        """One row an arena: the law's parameters there."""
        return [{"scenario": name, "delta_d": reach, **law._asdict()} for name, (law, reach) in self.laws.items()]

    def notes(self) -> str:
        """Markdown: the findings, and what is read differently."""
        lines = [f"# {self.title}", "", self.summary, "", *verdict_lines(self.findings), ""]
        return "\n".join([*lines, self.remarks, "", self.footnotes, ""])

    def write(self, folder: Path) -> list[str]:
        """Pictures, parameters and notes into `folder`."""
        law, delta_d = self.laws[_SMALL]
        scenario = load_scenario(_SMALL)
        size = scenario.arena.size[0], scenario.arena.size[1]
        geometry = scenario.arena.geometry
        goal, source = _goal(law, delta_d, self.seed)
        pictures = {
            "cohesion.png": cohesion_over_distance({_TITLES[name]: one for name, one in self.laws.items()}),
            "cohesion_field.png": cohesion_field(law, _ROBOTS, _WEIGHTS, delta_d),
            "obstacles.png": obstacle_field(geometry, size, _everywhere(law), _SPACING),
            "goal.png": goal_vectors(goal, geometry, size, source),
        }
        for name, picture in pictures.items():
            save(picture, folder / name)
        write_table(folder / "table.csv", pd.DataFrame(self.rows()))
        write_text(folder / "notes.md", self.notes())
        return [*pictures, "notes.md", "table.csv"]


def _law(scenario_name: str) -> tuple[LawParameters, float]:
    """The numbers that the policy `swarm` has in a scenario, and delta_d, m."""
    scenario = load_scenario(scenario_name)
    pilot = Swarm()
    pilot.reset(Briefing.of(scenario, 0, 0, np.array(scenario.team.starts[0], dtype=np.float64)))
    return pilot.robot.law, pilot.robot.hearing


def _sensed(places: FloatArray, law: LawParameters) -> checks.Sensed:
    scenario = load_scenario(_SMALL)
    area = np.array(scenario.arena.size, dtype=np.float64)
    return checks.sensed(scenario.arena.geometry, area, places, scenario.range_sensors.count, law)


def _faces() -> tuple[FloatArray, FloatArray]:
    """The middles (n, 3), m, of the obstacles' four upright faces, and their normals (n, 3), outwards."""
    boxes = load_scenario(_SMALL).arena.geometry.boxes
    normals = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    middle, half = (boxes[:, :3] + boxes[:, 3:]) / 2, (boxes[:, 3:] - boxes[:, :3]) / 2
    faces = middle[:, None] + normals * half[:, None]
    faces[..., 2] = _HEIGHT
    return faces.reshape(-1, 3), np.tile(normals, (len(boxes), 1))


def _beside_faces(law: LawParameters) -> tuple[checks.Sensed, FloatArray]:
    middles, normals = _faces()
    return _sensed(middles + _FACE_DISTANCE * normals, law), normals


def _approach(law: LawParameters) -> tuple[checks.Sensed, FloatArray]:
    middles, normals = _faces()
    return _sensed(middles[0] + _APPROACH[:, None] * normals[0], law), normals[0]


def _everywhere(law: LawParameters) -> checks.Sensed:
    """Over the arena, outside obstacles."""
    scenario = load_scenario(_SMALL)
    x, y = np.meshgrid(*(np.arange(_SPACING / 2, side, _SPACING) for side in scenario.arena.size[:2]))
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, _HEIGHT)], axis=1)
    boxes = scenario.arena.geometry.boxes
    inside = np.any(np.all((boxes[:, :3] <= places[:, None]) & (places[:, None] <= boxes[:, 3:]), axis=2), axis=1)
    return _sensed(places[~inside], law)


def _goal(law: LawParameters, delta_d: float, seed: int) -> tuple[Goal, FloatArray]:
    """Robots at random around a place in the plume, their temporal means, and eq 1; the source (3,) m."""
    world = World(load_scenario(_SMALL))
    world.reset([seed])
    places = _scattered(np.random.default_rng(seed))
    readings = np.zeros(_N_ROBOTS)
    filter_time = Swarm().filter_time
    for _ in range(round(_MEAN_TIME / _SAMPLE)):
        world.run_air(_SAMPLE)
        readings += -np.expm1(-_SAMPLE / filter_time) * (world.concentration(0, places) - readings)
    wind = world.wind_at(0, places)
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    goals = np.array([
        goal_vector(places[near] - places[i], readings[near], readings[i], wind[i], law)
        for i, near in enumerate((apart <= delta_d) & (apart > 0.0))
    ])  # fmt: skip
    upwind = -law.wind_gain * wind
    size = world.scenario.arena.size
    x, y = np.meshgrid(*((np.arange(n) + 0.5) * side / n for n, side in zip(_PLUME_CELLS, size, strict=False)))
    plume = world.concentration(0, np.stack([x, y, np.full_like(x, _HEIGHT)], axis=-1))
    unit = world.scenario.plume.unit
    picture = Goal(places[:, :2], readings, (goals - upwind)[:, :2], upwind[:, :2], plume, unit)
    return picture, world.source_position[0, 0].copy()


def _scattered(rng: np.random.Generator) -> FloatArray:
    """(n, 3) m outside obstacles, not too near to each other."""
    boxes = load_scenario(_SMALL).arena.geometry.boxes
    places: list[FloatArray] = []
    while len(places) < _N_ROBOTS:
        place = np.array([*(_SWARM_CENTRE + rng.uniform(-_SWARM_RADIUS, _SWARM_RADIUS, 2)), _HEIGHT])
        free = not np.any(np.all((boxes[:, :3] - 0.05 <= place) & (place <= boxes[:, 3:] + 0.05), axis=1))
        if free and all(np.linalg.norm(place - other) > 0.2 for other in places):
            places.append(place)
    return np.array(places)


EXPERIMENT = Forces()
