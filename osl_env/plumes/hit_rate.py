"""Rate-based plume: the mean rate at which a small spherical sensor meets odour parcels (Vergassola et al. 2007).

    R(u | s) = a Q / |u - s| * exp( (u - s) . V / (2 D) ) * exp( -|u - s| / lambda )      (MUC-OSL eq 1)
    lambda   = sqrt( D tau / (1 + |V|^2 tau / (4 D)) )                                     (MUC-OSL eq 2)

with V the wind velocity (where the air goes), written for any horizontal wind: eq 1 is printed for wind along -y.
With no wind the drift factor is 1 and lambda = sqrt(D tau): the field is isotropic. Assumptions: open air without
walls, a steady mean field, independent encounters. Only the product a Q can be told from hits, so it is one
parameter, `source_strength`; the paper page's A = a Q dt is `source_strength` times the sampling time (1 s in the
presets). |u - s| is clamped from below at `clamp_distance` in both factors, where the point-sensor formula diverges.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np
from numba import njit

from osl_env.numerics import exp
from osl_env.parameters import FloatArray, quantity
from osl_env.plumes.base import PlumeModel, Scene
from osl_env.state import BoolArray

_BLOCK = 256  # UAVs whose rates are computed together


@njit(inline="always", error_model="numpy")
def hit_rate(
    dx: float,
    dy: float,
    dz: float,
    drift_x: float,
    drift_y: float,
    inverse_lambda: float,
    strength: float,
    clamp_distance: float,
) -> float:
    """Mean hit rate, 1/s, of eq 1 at the offset (dx, dy, dz) = u - s, m. Inlined and vectorised in the kernels.

    `drift` is V / (2 D), 1/m (horizontal); `inverse_lambda` is 1 / lambda, 1/m; `strength` is a Q, m/s.
    """
    distance = max(math.sqrt(dx * dx + dy * dy + dz * dz), clamp_distance)
    return strength / distance * exp(dx * drift_x + dy * drift_y - distance * inverse_lambda)


@njit(cache=True, error_model="numpy")
def _field(
    positions: FloatArray,
    sources: FloatArray,
    strengths: FloatArray,
    drift_x: float,
    drift_y: float,
    inverse_lambda: float,
    clamp_distance: float,
    out: FloatArray,
) -> None:
    for k in range(positions.shape[0]):
        total = 0.0
        for s in range(sources.shape[0]):
            total += hit_rate(
                positions[k, 0] - sources[s, 0],
                positions[k, 1] - sources[s, 1],
                positions[k, 2] - sources[s, 2],
                drift_x,
                drift_y,
                inverse_lambda,
                strengths[s],
                clamp_distance,
            )
        out[k] = total


@njit(cache=True, error_model="numpy")
def _read(
    positions: FloatArray,
    sources: FloatArray,
    strengths: FloatArray,
    winds: FloatArray,
    source_strength: float,
    diffusivity: float,
    lifetime: float,
    clamp_distance: float,
    out: FloatArray,
) -> None:
    """Hit rates in blocks of UAVs: offsets are gathered into contiguous rows, over which eq 1 vectorises."""
    n_uavs = positions.shape[1]
    n = positions.shape[0] * n_uavs
    all_rates = out.reshape(-1)
    widest = min(_BLOCK, n)
    offset = np.empty((3, widest))
    wind = np.empty((2, widest))
    strength = np.empty(widest)
    half, growth, decay = 0.5 / diffusivity, lifetime / (4.0 * diffusivity), 1.0 / (diffusivity * lifetime)
    for start in range(0, n, _BLOCK):
        size = min(_BLOCK, n - start)
        rates = all_rates[start : start + size]  # a slice: an index that begins at 0 lets LLVM vectorise
        rates[:] = 0.0
        for s in range(sources.shape[1]):
            e, i = start // n_uavs, start % n_uavs
            for k in range(size):
                offset[0, k] = positions[e, i, 0] - sources[e, s, 0]
                offset[1, k] = positions[e, i, 1] - sources[e, s, 1]
                offset[2, k] = positions[e, i, 2] - sources[e, s, 2]
                wind[0, k], wind[1, k] = winds[e, 0], winds[e, 1]
                strength[k] = source_strength * strengths[e, s]
                i += 1
                if i == n_uavs:
                    e, i = e + 1, 0
            for k in range(size):
                u, v = wind[0, k], wind[1, k]
                inverse_lambda = math.sqrt((1.0 + (u * u + v * v) * growth) * decay)
                rates[k] += hit_rate(
                    offset[0, k],
                    offset[1, k],
                    offset[2, k],
                    half * u,
                    half * v,
                    inverse_lambda,
                    strength[k],
                    clamp_distance,
                )


class HitRatePlume(PlumeModel):
    """Rate-based plume (MUC-OSL eqs 1 to 3). Defaults: MUC-OSL Table 1 and the paper page's reading A = 2.5."""

    measures: ClassVar[Literal["hit_rate", "concentration"]] = "hit_rate"

    kind: Literal["hit_rate"] = "hit_rate"
    source_strength: float = quantity(2.5, "m/s", gt=0)  # a Q: sensor radius times release rate
    diffusivity: float = quantity(1.0, "m^2/s", gt=0)  # D, effective
    lifetime: float = quantity(100.0, "s", gt=0)  # tau, of a parcel
    clamp_distance: float = quantity(0.5, "m", gt=0)  # |u - s| is at least this

    @property
    def unit(self) -> str:
        """Of a hit rate."""
        return "1/s"

    @property
    def summary(self) -> str:
        """a Q, D and lifetime."""
        return f"a Q = {self.source_strength:g} m/s, D = {self.diffusivity:g} m²/s, lifetime {self.lifetime:g} s"

    def drift(self, wind_velocity: FloatArray) -> FloatArray:
        """V / (2 D), 1/m, for wind (..., 3) m/s; shape (..., 3)."""
        return np.asarray(wind_velocity, dtype=np.float64) / (2.0 * self.diffusivity)

    def inverse_lambda(self, wind_speed: float) -> float:
        """1 / lambda, 1/m, of eq 2 at `wind_speed` (V), m/s."""
        growth = 1.0 + wind_speed**2 * self.lifetime / (4.0 * self.diffusivity)
        return math.sqrt(growth / (self.diffusivity * self.lifetime))

    def field(self, positions: FloatArray, sources: FloatArray, strengths: FloatArray, wind: FloatArray) -> FloatArray:
        """Mean hit rate, 1/s, at `positions` (.., 3) m; shape (..). Vertical wind is ignored.

        From `sources` (n, 3) m with relative `strengths` (n,), in uniform `wind` (3,) m/s.
        """
        points = np.ascontiguousarray(positions, dtype=np.float64).reshape(-1, 3)
        out = np.empty(len(points))
        drift_x, drift_y, _ = self.drift(wind)
        inverse_lambda = self.inverse_lambda(math.hypot(float(wind[0]), float(wind[1])))
        scaled = self.source_strength * np.asarray(strengths, dtype=np.float64)
        sources = np.ascontiguousarray(sources, dtype=np.float64).reshape(-1, 3)
        _field(points, sources, scaled, drift_x, drift_y, inverse_lambda, self.clamp_distance, out)
        return out.reshape(np.shape(positions)[:-1])

    def read(self, state: Any, scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
        """Mean hit rate, 1/s, at `positions`, into `out`; see `PlumeModel.read`. All worlds are read at once."""
        _read(
            positions,
            scene.sources,
            scene.strengths,
            scene.air.mean,
            self.source_strength,
            self.diffusivity,
            self.lifetime,
            self.clamp_distance,
            out,
        )

    def at(self, state: Any, scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """The mean hit rate, 1/s, of world `env` at `points` (.., 3) m."""
        return self.field(points, scene.sources[env], scene.strengths[env], scene.air.mean[env])
