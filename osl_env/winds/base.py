"""What a wind is: parameters, and the air of a batch of worlds (`osl_env.air.Air`), which it fills and moves on.

Velocities point where the air goes. A wind that changes is advanced in ticks, with the plume; what it draws comes from
the world's own stream, so that two policies meet the same wind.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from osl_env.air import Air, uniform_air
from osl_env.arena import Arena
from osl_env.parameters import FloatArray, Parameters
from osl_env.state import BoolArray, IntArray


@dataclass(frozen=True, slots=True)
class WindState:
    """The air of all worlds, and what the wind model keeps of each."""

    air: Air
    memory: FloatArray  # (n_envs, k), as the model needs it
    streams: NDArray[np.uint64]  # (n_envs,), of Purpose.WIND


class Wind(Parameters):
    """Base of the wind models. The defaults are those of a wind that is uniform in space and steady in time."""

    @property
    def changes(self) -> bool:
        """Whether the air changes during an episode."""
        return False

    @property
    def tick(self) -> float:
        """s between two updates: the parameter `step` of a wind that changes, infinite for a steady one."""
        return float(getattr(self, "step", math.inf)) if self.changes else math.inf

    @property
    def uniform(self) -> bool:
        """Whether the air has the same velocity everywhere in a world."""
        return True

    @abstractmethod
    def draw(self, seeds: IntArray) -> FloatArray:
        """Mean wind velocity (n, 3), m/s, of the episodes with `seeds` (n,)."""

    def check(self, arena: Arena) -> None:
        """Raise ValueError ("key = value: what is wrong") if the wind does not fit the arena."""
        return

    def allocate(self, n_envs: int, arena: Arena) -> WindState:
        """Still air for `n_envs` worlds, and room for what the model keeps."""
        return WindState(uniform_air(n_envs), np.zeros((n_envs, 0)), np.zeros(n_envs, np.uint64))

    def begin(self, state: WindState, rows: IntArray, seeds: IntArray, start: float) -> None:
        """Set the air of the worlds `rows` for the episodes with `seeds`, as it is at the clock time `start`, s.

        `start` is 0, or negative where a plume develops before the episode: the air at a clock time must not depend
        on it more than a stationary process does.
        """
        state.air.mean[rows] = self.draw(seeds)

    def advance(self, state: WindState, due: BoolArray, clock: FloatArray, tick: float) -> None:
        """Move the air of the worlds of `due` (n_envs,) on by `tick` s, to the times `clock` (n_envs,), s."""
        return
