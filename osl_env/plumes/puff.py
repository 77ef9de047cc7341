"""Gaussian puffs: a source lets go of a puff every `interval` s, which drifts with the air, rises, and grows.

    c(x, y, z, t) = sum over the puffs k of eq 2 (see `puff_kernels`)                                 (chemotaxis eq 1)
    d(x_k, y_k, z_k)/dt = air velocity at the puff's centre + (0, 0, rise)                            (chemotaxis eq 3)

after Jia et al. (2025, FastGaussianPuff). The paper's wind blows along +x; here every puff keeps a centre of its own
and goes where the air is going, so that a plume bends when the wind turns. sigma_y and sigma_z follow a dispersion
law (`osl_env.plumes.dispersion`) of the distance that the puff itself has travelled, which is the path of the air
that carries it; in a wind slower than `calm_speed` a puff spreads as if it travelled at that speed. The model needs
no wind.

Assumptions: puffs stay round in the horizontal and do not shear; the ground (`ground`, a height in the arena's
coordinates) reflects, a centre that sinks to it stays on it, and below it there is no gas; obstacles are not seen. A
puff ends at `max_age`; beyond `cut_off` standard deviations from its centre (an ellipsoid) it reads exactly zero,
which leaves out 7e-8 of its mass at the default. Beyond the bounds of the arena puffs go on, and may come back.

Time: the model ticks every `step` s; a reading is that of the last tick. Release k is at k `interval`, also between
ticks, and ages are exact. With `steady_start` the air holds at first what the sources would have released for
`max_age` in the air as it then is; in a wind that changes, `development` lets the plume grow before the episode
begins.

Deviation: the chemotaxis page reads sigma_y = 0.22 x for Briggs A; Briggs's own 0.22 x / sqrt(1 + 1e-4 x) is 0.25 %
less at 50 m.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.errors import InputError
from osl_env.parameters import FloatArray, quantity
from osl_env.plumes import puff_kernels
from osl_env.plumes.base import Scene
from osl_env.plumes.dispersion import BriggsOpenCountry, Dispersion, DispersionLaw
from osl_env.plumes.emission import EmissionPlume
from osl_env.plumes.puff_kernels import BLOCK, PuffConstants, PuffState
from osl_env.state import BoolArray, IntArray

_MAX_PUFFS = 1_000_000  # of a world: 64 bytes each


class GaussianPuffPlume(EmissionPlume):
    """Gaussian puffs. Defaults: the chemotaxis paper's plume, as its page reads it."""

    kind: Literal["gaussian_puff"] = "gaussian_puff"
    release_rate: float = quantity(66.7, "g/s", gt=0)  # Q; a puff holds Q interval
    interval: float = quantity(0.5, "s", gt=0)  # between two releases
    step: float = quantity(0.05, "s", gt=0)  # of the model; divides `interval`, or is a multiple of it
    max_age: float = quantity(25.0, "s", gt=0)  # of a puff
    rise: float = quantity(0.15, "m/s")  # w_buoy: buoyancy, against the air; negative for a heavy gas
    dispersion: Dispersion = quantity(BriggsOpenCountry(), "", discriminator="kind")
    calm_speed: float = quantity(0.5, "m/s", ge=0)  # a puff spreads as if it travelled at least so fast
    ground: float | None = quantity(None, "m", le=0)  # height of the reflecting ground; none: open below
    cut_off: float = quantity(6.0, "", ge=3, le=30)  # standard deviations from the centre where a puff ends
    steady_start: bool = True  # begin among the puffs of all ages, not in clean air
    development: float = quantity(0.0, "s", ge=0)  # time for which the plume grows before the episode

    @model_validator(mode="before")
    @classmethod
    def _default_law(cls, values: Any) -> Any:
        """A dispersion without a `kind` is the default one."""
        if isinstance(values, dict) and isinstance(values.get("dispersion"), dict):
            return values | {"dispersion": {"kind": "briggs_open_country"} | values["dispersion"]}
        return values

    @model_validator(mode="after")
    def _whole_ticks(self) -> GaussianPuffPlume:
        ratio = max(self.interval / self.step, self.step / self.interval)
        if abs(ratio - round(ratio)) > 1e-6:
            raise ValueError(f"step = {self.step}: must divide interval = {self.interval} s, or be a multiple of it")
        if self.max_age / self.interval > _MAX_PUFFS:
            raise ValueError(
                f"max_age = {self.max_age}: more than {_MAX_PUFFS} puffs at one every interval = {self.interval} s"
            )
        return self

    @property
    def tick(self) -> float:
        """s between two updates."""
        return self.step

    @property
    def lead_time(self) -> float:
        """s for which the plume develops before an episode begins."""
        return self.development

    @property
    def releases(self) -> int:
        """How many puffs of one source there are at most."""
        return math.floor(self.max_age / self.interval + 1e-9) + 1

    @cached_property
    def law(self) -> DispersionLaw:
        """The dispersion law for compiled code."""
        return self.dispersion.law()

    @cached_property
    def constants(self) -> PuffConstants:
        """The parameters for compiled code."""
        return PuffConstants(
            self.step,
            self.interval,
            self.max_age,
            self.rise,
            self.calm_speed,
            -math.inf if self.ground is None else self.ground,
            self.scaled_rate * self.interval,
            0.5 * self.cut_off**2,
            self.steady_start,
        )

    def check(self, arena: Arena, n_sources: int) -> None:
        """Raise ValueError if the sources together have too many puffs."""
        if self.releases * n_sources > _MAX_PUFFS:
            raise ValueError(
                f"max_age = {self.max_age}: {n_sources} sources with a puff every {self.interval} s make more than"
                f" {_MAX_PUFFS} puffs"
            )

    def axis_mean(self, distance: float, speed: float) -> float:
        """Q / (2 pi V sigma_y sigma_z): the Gaussian plume of dense puffs that do not rise."""
        wind = max(speed, self.calm_speed)
        sigma_y, sigma_z = self.dispersion.sigmas(distance, distance / wind)
        return self.scaled_rate / (2.0 * math.pi * wind * float(sigma_y) * float(sigma_z))

    def allocate(self, n_envs: int, n_sources: int, arena: Arena | None = None) -> PuffState:
        """The puffs of `n_envs` worlds, none yet; room for all that there can be."""
        puffs = np.zeros((n_envs, 8, self.releases * n_sources))
        puffs[:, (puff_kernels.ACROSS, puff_kernels.UP)] = 1.0
        return PuffState(puffs, np.zeros(n_envs, np.int64), np.zeros(n_envs, np.int64))

    def begin(self, state: PuffState, scene: Scene, rows: IntArray, seeds: IntArray) -> None:
        """Put the worlds `rows` at the moment of the first release, in the air as it is; nothing is random."""
        puff_kernels.begin(state, scene.air, scene.sources, scene.strengths, self.law, self.constants, rows)

    def advance(self, state: PuffState, scene: Scene, due: BoolArray) -> None:
        """One tick of the worlds of `due` (n_envs,)."""
        puff_kernels.advance(state, scene.air, scene.sources, scene.strengths, self.law, self.constants, due)

    def read(self, state: PuffState, scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
        """Concentration at `positions`, into `out`; see `PlumeModel.read`."""
        puff_kernels.read(state, self.constants, positions, due, out)

    def at(self, state: PuffState, scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """Concentration of world `env` at `points` (.., 3) m; shape (..)."""
        order, blocks, boxes = _in_blocks(points)
        readings = np.empty((len(boxes), BLOCK))
        puff_kernels.at(state.puffs[env], self.constants, blocks, boxes, readings)
        out = np.empty(order.size)
        out[order] = readings.reshape(-1)[: order.size]
        return out.reshape(np.shape(points)[:-1])


def _in_blocks(points: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """The `points` (.., 3) m in blocks of neighbours: their order, the blocks (m, 3, BLOCK), and their boxes (m, 6).

    Strips along x are sorted by y and cut. The last block is filled up with its last point.
    """
    flat = np.asarray(points, np.float64).reshape(-1, 3)
    n_blocks = -(-len(flat) // BLOCK)
    strip = np.empty(len(flat), np.int64)
    strip[np.argsort(flat[:, 0], kind="stable")] = np.arange(len(flat)) // (math.isqrt(max(n_blocks, 1)) * BLOCK)
    order = np.lexsort((flat[:, 1], strip))
    filled = np.concatenate([order, np.repeat(order[-1:], n_blocks * BLOCK - len(flat))])
    blocks = np.ascontiguousarray(flat[filled].reshape(n_blocks, BLOCK, 3).transpose(0, 2, 1))
    return order, blocks, np.concatenate([blocks.min(axis=2), blocks.max(axis=2)], axis=1)


def puff_series(
    plume: GaussianPuffPlume,
    sources: FloatArray,
    winds: FloatArray,
    receptors: FloatArray,
    strengths: FloatArray | None = None,
) -> FloatArray:
    """Concentrations at fixed `receptors` (m, 3) m over time, in one compiled pass; no bounds, no UAVs.

    `sources` (n, 3) m with relative `strengths` (n,), default 1; `winds` (t, 3) m/s, uniform in space: row i blows
    during tick i, from i `step` to (i + 1) `step`. Returns (t, m): row i is the reading at (i + 1) `step`. A steady
    start is that of the first wind. The physics is that of the model in a World, whose readings these are. Raises
    InputError for other shapes.
    """
    winds, places = np.asarray(winds, np.float64), np.asarray(receptors, np.float64)
    origins = np.asarray(sources, np.float64)
    for name, array in (("sources", origins), ("winds", winds), ("receptors", places)):
        if array.ndim != 2 or array.shape[1] != 3 or not np.isfinite(array).all():
            raise InputError(f"{name}: must be finite numbers of shape (n, 3), is {array.shape}")
    shares = np.ones(len(origins)) if strengths is None else np.asarray(strengths, np.float64)
    if shares.shape != (len(origins),):
        raise InputError(f"strengths: must be one number for each of {len(origins)} sources, is {shares.shape}")
    order, blocks, boxes = _in_blocks(places)
    out = np.empty((len(winds), order.size))
    if len(winds) and len(origins):
        state = plume.allocate(1, len(origins))
        puff_kernels.series(
            state,
            uniform_air(1),
            origins[None],
            shares[None],
            plume.law,
            plume.constants,
            winds,
            blocks,
            boxes,
            order,
            out,
        )
    else:
        out[:] = 0.0
    return out
