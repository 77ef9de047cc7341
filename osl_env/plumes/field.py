"""Gas played back from fields: concentrations computed elsewhere (GADEN, CFD), interpolated in space and time.

Each field holds the gas of its own source or sources at their places; several fields add up. A reading is trilinear
between the centres of cells and linear between frames, and 0 outside a field's grid. Assumptions: the sources stand
where they stood when the fields were computed (the fields' cards say where), and a source's relative strength scales
its gas, which is linear in the release rate. With the wind of the same case, the same `loop`, `random_start` and
`speed_factor` keep the two at the same time.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import field_validator

from osl_env.arena import Arena
from osl_env.errors import InputError
from osl_env.fields.field import Field
from osl_env.fields.interpolation import concentration_at
from osl_env.fields.library import load_field
from osl_env.fields.playback import fitting_field, set_frames, start_shares, writable
from osl_env.parameters import FloatArray, Vector, quantity
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.state import BoolArray, IntArray


class Playback(NamedTuple):
    """One field, and where in its time each world is."""

    grid: NDArray[np.float32]  # (n_t, nx, ny, nz); shared by all worlds
    cells: NDArray[np.uint8]  # (nx, ny, nz) solid cells, or empty
    origin: FloatArray  # (3,) m: the centre of the first cell in the arena
    spacing: FloatArray  # (3,) m
    times: FloatArray  # (n_t,) s
    period: float  # s; 0: the ends hold
    starts: FloatArray  # (n_envs,) s: the time of the field at which the episode began
    ticks: IntArray  # (n_envs,): ticks since then
    frame: IntArray  # (n_envs, 2)
    blend: FloatArray  # (n_envs,)
    scale: FloatArray  # (n_envs,): of the concentration


@njit(cache=True, error_model="numpy")
def _add_readings(played: Playback, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
    for e in range(due.size):
        if not due[e]:
            continue
        first, second, blend = played.frame[e, 0], played.frame[e, 1], played.blend[e]
        for i in range(positions.shape[1]):
            x, y, z = positions[e, i, 0], positions[e, i, 1], positions[e, i, 2]
            out[e, i] += played.scale[e] * concentration_at(
                played.grid, played.cells, played.origin, played.spacing, first, second, blend, x, y, z
            )


class FieldPlume(PlumeModel):
    """Gas of field files. Each field stands for its own sources: the scenario's, in the order of `fields`."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "concentration"

    kind: Literal["playback"] = "playback"
    fields: tuple[str, ...] = ()  # shipped names, or paths of fields' .npz files, with a concentration each
    offset: Vector = quantity((0.0, 0.0, 0.0), "m")  # where the origin of the fields' coordinates is in the arena
    speed_factor: float = quantity(1.0, "", gt=0, le=100)  # as the wind's: time goes faster, gas is thinner
    loop: bool = True  # begin anew after the last frame; otherwise it holds
    random_start: bool = False  # begin each episode at another time of the loop, the wind's
    step: float = quantity(0.1, "s", gt=0)  # between two updates of the blend of frames

    @field_validator("fields", mode="before")
    @classmethod
    def _one_or_more(cls, fields: Any) -> Any:
        return (fields,) if isinstance(fields, str) else fields

    @property
    def unit(self) -> str:
        """The unit of the (first) field's concentration."""
        return load_field(self.fields[0]).unit if self.fields else "ppm"

    @property
    def summary(self) -> str:
        """Which fields."""
        return f"gas of {', '.join(self.fields)}"

    @property
    def tick(self) -> float | None:
        """`step`, s; None if every field is a single frame."""
        return self.step if any(load_field(name).n_frames > 1 for name in self.fields) else None

    def source_positions(self) -> FloatArray:
        """(n, 3) m: where the sources of the fields are in the arena, as their cards say, in the order of `fields`."""
        found = [load_field(name).sources + np.array(self.offset) for name in self.fields]
        return np.concatenate([np.empty((0, 3)), *found])

    def check(self, arena: Arena, n_sources: int) -> None:
        """Raise ValueError if a field holds no gas, does not cover the arena, or has other sources than are told."""
        if not self.fields:
            raise ValueError("fields = (): name at least one field with a concentration")
        if self.random_start and not self.loop:
            raise ValueError("random_start = True: needs loop = true, or episodes would begin near the end")
        unit, sources = "", 0
        for name in self.fields:
            field = fitting_field("fields", name, self.offset, arena.size)
            if field.concentration is None:
                raise ValueError(f"fields = {name!r}: holds no concentration, only a wind; gas is needed")
            unit = unit or field.unit
            if field.unit != unit:
                raise ValueError(
                    f"fields = {name!r}: is in {field.unit!r}, the first one in {unit!r}; must be the same"
                )
            sources += _n_sources(field)
        if sources != n_sources:
            raise ValueError(
                f"fields = {list(self.fields)}: hold the gas of {sources} sources, and the scenario has {n_sources};"
                " sources.positions must be theirs"
            )

    def allocate(self, n_envs: int, n_sources: int, arena: Arena) -> tuple[Playback, ...]:
        """The playback of each field; the grids are shared by all worlds."""
        return tuple(self._played(load_field(name), n_envs) for name in self.fields)

    def _played(self, field: Field, n_envs: int) -> Playback:
        assert field.concentration is not None
        return Playback(
            grid=writable(field.concentration),
            cells=writable(field.cells),
            origin=field.origin + np.array(self.offset),
            spacing=field.spacing.copy(),
            times=writable(field.times),
            period=field.loop_period if self.loop else 0.0,
            starts=np.zeros(n_envs),
            ticks=np.zeros(n_envs, np.int64),
            frame=np.zeros((n_envs, 2), np.int64),
            blend=np.zeros(n_envs),
            scale=np.ones(n_envs),
        )

    def begin(self, state: tuple[Playback, ...], scene: Scene, rows: IntArray, seeds: IntArray) -> None:
        """Put the worlds `rows` where the episodes with `seeds` begin.

        Raises InputError if the sources of one field have different strengths, which its sum cannot show.
        """
        shares = start_shares(seeds) if self.random_start else np.zeros(len(rows))
        due = np.zeros(len(scene.strengths), np.bool_)
        due[rows] = True
        source = 0
        for name, played in zip(self.fields, state, strict=True):
            strengths = scene.strengths[rows, source : source + _n_sources(load_field(name))]
            source += strengths.shape[1]
            if np.any(strengths != strengths[:, :1]):
                raise InputError(f"sources.strengths: the sources of field {name!r} are summed in it; must be equal")
            played.scale[rows] = strengths[:, 0] / self.speed_factor
            played.starts[rows] = shares * played.period
            played.ticks[rows] = 0
            self._show(played, due)

    def advance(self, state: tuple[Playback, ...], scene: Scene, due: BoolArray) -> None:
        """Blend the frames of the next tick; see `PlumeModel.advance`."""
        for played in state:
            played.ticks[due] += 1
            self._show(played, due)

    def _show(self, played: Playback, due: BoolArray) -> None:
        clock: FloatArray = played.ticks.astype(np.float64) * self.step
        set_frames(
            played.times, played.period, self.speed_factor, played.starts, clock, due, played.frame, played.blend
        )

    def read(
        self, state: tuple[Playback, ...], scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray
    ) -> None:
        """The present concentration; see `PlumeModel.read`."""
        out[due] = 0.0
        for played in state:
            _add_readings(played, positions, due, out)

    def at(self, state: tuple[Playback, ...], scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """The present concentration of world `env` at `points` (.., 3) m; shape (..)."""
        flat = np.ascontiguousarray(points, dtype=np.float64).reshape(1, -1, 3)
        out = np.zeros((1, flat.shape[1]))
        for played in state:
            one = slice(env, env + 1)
            alone = played._replace(frame=played.frame[one], blend=played.blend[one], scale=played.scale[one])
            _add_readings(alone, flat, np.ones(1, np.bool_), out)
        return out.reshape(np.shape(points)[:-1])


def _n_sources(field: Field) -> int:
    """How many sources the gas of `field` has: those in its card, or one."""
    return len(field.sources) or 1
