"""Steady pseudo-Gaussian plume: the mean concentration downwind of a point source (GaSLAM eq 2; Rahbar et al. 2019).

    C = Q / (2 pi U sy sz) exp(-y^2 / (2 sy^2) - z^2 / (2 sz^2)),   sy = ay x + by,  sz = az x + bz,    for x >= 0

with x the distance downwind of the source, y across the wind and z above the source, for any horizontal wind; nothing
is upwind. The paper's wind blows along +x. Assumptions: open air without ground or walls, a steady uniform wind; the
vertical wind is ignored. Through every plane across the wind passes the whole release rate Q. In a field of wind
(`osl_env.air`), the episode's mean wind is meant.

Wind slower than `minimum_speed` keeps its direction and counts as that fast. Air at rest has no downwind side: then
the gas spreads to all sides alike at `minimum_speed`, so that Q passes through every upright cylinder around the
source,

    C = Q / ((2 pi)^{3/2} U r sz) exp(-z^2 / (2 sz^2)),      r >= sy / sqrt(2 pi): no more than eq 2 on the axis

with r the horizontal distance from the source.
"""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numba import njit

from osl_env.numerics import exp
from osl_env.parameters import FloatArray, quantity
from osl_env.plumes.base import Scene
from osl_env.plumes.emission import EmissionPlume
from osl_env.state import BoolArray

_SQRT_2_PI = math.sqrt(2.0 * math.pi)


@njit(inline="always", error_model="numpy")
def _concentration(dx: float, dy: float, dz: float, u: float, v: float, speed: float, q: float, shape: Any) -> float:
    """Eq 2 at the offset (dx, dy, dz), m, from a source of rate `q`, in wind (u, v) of `speed`, m/s; 0 if at rest."""
    growth_y, width_y, growth_z, width_z, minimum_speed = shape
    carried = max(speed, minimum_speed)
    if speed > 0.0:
        x = (dx * u + dy * v) / speed
        y = (dy * u - dx * v) / speed
        if x < 0.0:
            return 0.0
        sigma_y = growth_y * x + width_y
        sigma_z = growth_z * x + width_z
        peak = q / (2.0 * math.pi * carried * sigma_y * sigma_z)
        return float(peak * exp(-0.5 * ((y / sigma_y) ** 2 + (dz / sigma_z) ** 2)))
    r = math.sqrt(dx * dx + dy * dy)
    sigma_y = growth_y * r + width_y
    sigma_z = growth_z * r + width_z
    ring = 2.0 * math.pi * max(r, sigma_y / _SQRT_2_PI)
    return float(q / (ring * _SQRT_2_PI * carried * sigma_z) * exp(-0.5 * (dz / sigma_z) ** 2))


@njit(error_model="numpy")
def _total(x: float, y: float, z: float, sources: Any, strengths: Any, wind: Any, rate: float, shape: Any) -> float:
    speed = math.sqrt(wind[0] * wind[0] + wind[1] * wind[1])
    total = 0.0
    for s in range(sources.shape[0]):
        total += _concentration(
            x - sources[s, 0],
            y - sources[s, 1],
            z - sources[s, 2],
            wind[0],
            wind[1],
            speed,
            rate * strengths[s],
            shape,
        )
    return total


@njit(cache=True, error_model="numpy")
def _field(
    points: FloatArray,
    sources: FloatArray,
    strengths: FloatArray,
    wind: FloatArray,
    rate: float,
    shape: Any,
    out: FloatArray,
) -> None:
    for k in range(out.size):
        out[k] = _total(points[k, 0], points[k, 1], points[k, 2], sources, strengths, wind, rate, shape)


@njit(cache=True, error_model="numpy")
def _read(
    positions: FloatArray,
    sources: FloatArray,
    strengths: FloatArray,
    winds: FloatArray,
    rate: float,
    shape: Any,
    due: BoolArray,
    out: FloatArray,
) -> None:
    for e in range(due.size):
        if due[e]:
            for i in range(positions.shape[1]):
                x, y, z = positions[e, i, 0], positions[e, i, 1], positions[e, i, 2]
                out[e, i] = _total(x, y, z, sources[e], strengths[e], winds[e], rate, shape)


class PseudoGaussianPlume(EmissionPlume):
    """Steady pseudo-Gaussian plume (GaSLAM eq 2). The defaults suit a tunnel of some metres."""

    kind: Literal["pseudo_gaussian"] = "pseudo_gaussian"
    release_rate: float = quantity(1.0, "g/s", gt=0)  # Q
    growth_y: float = quantity(0.1, "", ge=0)  # ay: growth of sigma_y with the distance downwind
    growth_z: float = quantity(0.1, "", ge=0)  # az
    width_y: float = quantity(0.1, "m", gt=0)  # by: sigma_y at the source
    width_z: float = quantity(0.1, "m", gt=0)  # bz
    minimum_speed: float = quantity(0.05, "m/s", gt=0)  # slower wind counts as this fast

    @property
    def _shape(self) -> tuple[float, float, float, float, float]:
        return self.growth_y, self.width_y, self.growth_z, self.width_z, self.minimum_speed

    def field(self, positions: FloatArray, sources: FloatArray, strengths: FloatArray, wind: FloatArray) -> FloatArray:
        """Concentration at `positions` (.., 3) m from `sources` (n, 3) m with relative `strengths` (n,) in uniform
        `wind` (3,) m/s; shape (..).
        """
        points = np.ascontiguousarray(positions, np.float64).reshape(-1, 3)
        out = np.empty(len(points))
        origins = np.ascontiguousarray(sources, np.float64).reshape(-1, 3)
        shares, wind = np.asarray(strengths, np.float64), np.asarray(wind, np.float64)
        _field(points, origins, shares, wind, self.scaled_rate, self._shape, out)
        return out.reshape(np.shape(positions)[:-1])

    def axis_mean(self, distance: float, speed: float) -> float:
        """Eq 2 on the axis."""
        wind = np.array([max(speed, self.minimum_speed), 0.0, 0.0])
        return float(self.field(np.array([distance, 0.0, 0.0]), np.zeros((1, 3)), np.ones(1), wind))

    def read(self, state: Any, scene: Scene, positions: FloatArray, due: BoolArray, out: FloatArray) -> None:
        """Concentration at `positions`, into `out`; see `PlumeModel.read`."""
        _read(positions, scene.sources, scene.strengths, scene.air.mean, self.scaled_rate, self._shape, due, out)

    def at(self, state: Any, scene: Scene, env: int, points: FloatArray) -> FloatArray:
        """Concentration of world `env` at `points` (.., 3) m."""
        return self.field(points, scene.sources[env], scene.strengths[env], scene.air.mean[env])
