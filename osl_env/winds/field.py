"""Wind played back from a field: frames of a flow computed elsewhere, trilinear in space and linear in time.

All worlds share one grid; each has its own place in the field's time. Assumptions: the flow repeats with the field's
period (or its last frame holds), and nothing in an episode acts back on it. The shipped fields are the swarm paper's
arenas, from OpenFOAM.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field as Key

from osl_env.air import Air
from osl_env.arena import Arena
from osl_env.fields.field import Field
from osl_env.fields.library import load_field
from osl_env.fields.playback import fitting_field, set_frames, start_shares, writable
from osl_env.parameters import FloatArray, Vector, quantity
from osl_env.state import BoolArray, IntArray
from osl_env.winds.base import Wind, WindState


@dataclass(frozen=True, slots=True)
class FieldWindState(WindState):
    """The air of all worlds; `memory` (n_envs, 1) holds the time of the field, s, at which the episodes began."""

    times: FloatArray  # (n_t,) s, of the field's frames
    period: float  # s; 0: the ends hold


class FieldWind(Wind):
    """Wind of a field file; see `osl plume show NAME` for what a field is like."""

    kind: Literal["field"] = "field"
    field: str = Key("arena-4x6-5", min_length=1)  # a shipped field's name, or the path of a field's .npz file
    offset: Vector = quantity((0.0, 0.0, 0.0), "m")  # where the origin of the field's coordinates is in the arena
    speed_factor: float = quantity(1.0, "", gt=0, le=100)  # of velocities, and of how fast the field's time goes
    loop: bool = True  # begin anew after the last frame; otherwise it holds
    random_start: bool = False  # begin each episode at another time of the loop
    step: float = quantity(0.1, "s", gt=0)  # between two updates of the blend of frames

    @property
    def changes(self) -> bool:
        """Whether the field has more than one frame."""
        return load_field(self.field).n_frames > 1

    @property
    def uniform(self) -> bool:
        """A field never is: False."""
        return False

    def check(self, arena: Arena) -> None:
        """Raise ValueError if the field cannot be read, has no wind, or does not cover the arena."""
        field = fitting_field("field", self.field, self.offset, arena.size)
        if field.wind is None:
            raise ValueError(f"field = {self.field!r}: holds no wind, only a concentration; a wind field is needed")
        if self.random_start and not self.loop:
            raise ValueError("random_start = True: needs loop = true, or episodes would begin near the end")

    def draw(self, seeds: IntArray) -> FloatArray:
        """The field's mean wind velocity, m/s, for each of `seeds` (n,); shape (n, 3)."""
        return np.tile(load_field(self.field).mean_wind * self.speed_factor, (len(seeds), 1))

    def allocate(self, n_envs: int, arena: Arena) -> FieldWindState:
        """The air of `n_envs` worlds: one grid for all of them, and for all batches in the process."""
        field = load_field(self.field)
        assert field.wind is not None
        air = Air(
            mean=np.tile(field.mean_wind * self.speed_factor, (n_envs, 1)),
            grid=writable(field.wind) if self.speed_factor == 1.0 else _scaled(field, self.speed_factor),
            frame=np.zeros((n_envs, 2), np.int64),
            blend=np.zeros(n_envs),
            origin=field.origin + np.array(self.offset),
            spacing=field.spacing.copy(),
        )
        period = field.loop_period if self.loop else 0.0
        streams = np.zeros(n_envs, np.uint64)
        return FieldWindState(air, np.zeros((n_envs, 1)), streams, writable(field.times), period)

    def begin(self, state: WindState, rows: IntArray, seeds: IntArray, start: float) -> None:
        """Put the worlds `rows` where the episodes with `seeds` begin, at the clock time `start`, s."""
        assert isinstance(state, FieldWindState)
        state.memory[rows, 0] = start_shares(seeds) * state.period if self.random_start else 0.0
        due = np.zeros(len(state.memory), np.bool_)
        due[rows] = True
        self.advance(state, due, np.full(len(due), start), 0.0)

    def advance(self, state: WindState, due: BoolArray, clock: FloatArray, tick: float) -> None:
        """Blend the frames of the times `clock` (n_envs,), s, in the worlds of `due`; see `Wind.advance`."""
        assert isinstance(state, FieldWindState)
        air, starts = state.air, state.memory[:, 0]
        set_frames(state.times, state.period, self.speed_factor, starts, clock, due, air.frame, air.blend)


@lru_cache(maxsize=2)
def _scaled(field: Field, factor: float) -> NDArray[np.float32]:
    """The field's velocities times `factor`: one array for all who play it back."""
    assert field.wind is not None
    return field.wind * np.float32(factor)
