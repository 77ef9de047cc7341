"""What a plume model is: parameters, a state for a batch of worlds, and a batched reading at the UAVs' positions.

A plume gives either a hit rate (encounters per second, for a counting sensor) or a concentration. A steady plume is a
function of the place and the wind, and has no state; one that changes is advanced in ticks of `tick` s. All methods
are batched over worlds, and what happens in a world depends on nothing outside it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from osl_env.air import Air
from osl_env.arena import Arena
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray, Parameters
from osl_env.state import BoolArray, IntArray


@dataclass(frozen=True, slots=True)
class Scene:
    """What the plumes of a batch of worlds are in. The arrays are the World's own, and change as it goes on."""

    sources: FloatArray  # (n_envs, n_sources, 3) m
    strengths: FloatArray  # (n_envs, n_sources), relative release rates
    air: Air
    geometry: Geometry
    area: FloatArray  # (3,) m: the arena is [0, Lx] x [0, Ly] x [0, Lz]
    positions: FloatArray  # (n_envs, n_uavs, 3) m: where the UAVs are at this tick


class PlumeModel(Parameters):
    """Base of the plume models. `measures` says what `read` gives: a hit rate (1/s) or a concentration in `unit`."""

    measures: ClassVar[Literal["hit_rate", "concentration"]]

    @property
    @abstractmethod
    def unit(self) -> str:
        """The unit of a reading: "1/s", "ppm", "g/m^3", ..."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """Its main parameters in a few words, for tables and reports."""

    @property
    def tick(self) -> float | None:
        """s between two updates; None for a steady plume."""
        return None

    @property
    def lead_time(self) -> float:
        """s for which the plume develops before an episode begins; 0: it begins at the clean air."""
        return 0.0

    def check(self, arena: Arena, n_sources: int) -> None:
        """Raise ValueError ("key = value: what is wrong") if the parameters do not fit the arena or the sources."""
        return

    def allocate(self, n_envs: int, n_sources: int, arena: Arena) -> Any:
        """The state of `n_envs` worlds: a NamedTuple of arrays whose first axis is the world; None if steady."""
        return None

    def begin(self, state: Any, scene: Scene, rows: IntArray, seeds: IntArray) -> None:
        """Clear the worlds `rows` for the episodes with `seeds`: clean air, fresh random streams."""
        return

    def advance(self, state: Any, scene: Scene, due: BoolArray) -> None:
        """One tick in the worlds of `due` (n_envs,): release, move with the air, grow, end."""
        return

    @abstractmethod
    def read(self, state: Any, scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
        """The present reading at `positions` (n_envs, n, 3) m in the worlds of `due` (n_envs,), into `out` (n_envs, n).

        Rows of other worlds may be written too, and mean nothing. `positions` may be a strided view.
        """

    def axis_mean(self, distance: float, speed: float) -> float:
        """The mean reading on the axis of the steady plume, `distance` m downwind of a source in wind of `speed` m/s.

        In open air, without a floor. Infinite where the model cannot say it.
        """
        return math.inf

    @abstractmethod
    def at(self, state: Any, scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """The present reading of world `env` at `points` (.., 3) m; shape (..). For pictures and exports."""
