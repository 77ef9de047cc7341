"""What one CFD case is: the YAML files of `cases/`, with the area and the obstacles of the scenario preset."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from osl_env.configuration import config_folder, merged, read_yaml
from osl_env.parameters import Parameters, Vector, quantity

Box = tuple[Vector, Vector]  # low and high corner, m


class Inlet(Parameters):
    """The air that enters at x = 0: a wandering direction, and fluctuations that are correlated along y and in time."""

    speed: float = quantity(0.5, "m/s", gt=0)
    angle: float = quantity(0.1, "rad", ge=0, lt=1)  # standard deviation of the direction
    angle_time: float = quantity(4.0, "s", gt=0)  # correlation time of the direction
    noise: float = quantity(0.02, "m/s", ge=0)  # standard deviation of each component
    noise_time: float = quantity(1.0, "s", gt=0)
    noise_length: float = quantity(0.3, "m", gt=0)
    period: float = quantity(100.0, "s", gt=0)  # the inlet repeats itself: so does the flow, nearly
    step: float = quantity(0.25, "s", gt=0)  # between the inlet's profiles; linear in between
    seed: int = quantity(1, "", ge=0)


class Case(Parameters):
    """A 2D case of incompressible flow through an arena; walls along y slip, obstacles do not."""

    scenario: str  # a preset: its `arena` gives the size and the obstacles
    description: str
    cell: float = quantity(0.05, "m", gt=0)
    viscosity: float = quantity(2e-3, "m^2/s", gt=0)  # effective: stands for the turbulence that 2D cannot hold
    courant: float = quantity(0.8, "", gt=0, lt=2)  # greatest Courant number
    inlet: Inlet = Inlet()
    spin_up: float = quantity(40.0, "s", gt=0)  # thrown away
    seam: float = quantity(8.0, "s", gt=0)  # the end is faded into the beginning over this time
    search: float = quantity(20.0, "s", ge=0)  # the loop begins where the two ends match best within this time
    frame_period: float = quantity(0.25, "s", gt=0)  # between two frames of the field
    resolution: float = quantity(0.01, "m/s", gt=0)  # what the velocity is rounded to

    @property
    def duration(self) -> float:
        """s of flow to compute."""
        return self.spin_up + self.search + self.inlet.period + self.seam


def read_case(path: Path) -> Case:
    """The case in the YAML file at `path`."""
    return Case.model_validate(read_yaml(path))


def read_preset(scenario: str) -> dict[str, Any]:
    """The content of the preset `scenario`, with that of its base."""
    content = read_yaml(config_folder() / "scenarios" / f"{scenario}.yaml")
    base = content.pop("base", None)
    return merged(read_preset(base), content) if base else content


def read_arena(scenario: str) -> tuple[Vector, list[Box]]:
    """Size of the preset's arena and its boxes."""
    arena: dict[str, Any] = read_preset(scenario)["arena"]
    obstacles = arena.get("obstacles", [])
    if any(obstacle["kind"] != "box" for obstacle in obstacles):
        raise ValueError(f"scenario {scenario}: arena.obstacles: only boxes can be meshed")
    x, y, z = arena["size"]
    return (x, y, z), [(tuple(obstacle["low"]), tuple(obstacle["high"])) for obstacle in obstacles]
