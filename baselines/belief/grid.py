"""Exact Bayesian belief about one source's position on a grid of cells, batched over beliefs.

    p_k(cell) ~ p_{k-1}(cell) * Poisson( d_k ; (R(u_k | cell) + false-positive rate) dt_k )      (MUC-OSL eqs 1 to 3)

in the log domain, starting from the uniform distribution over the search volume. Every reading counts, one without a
hit too. R is the advertised plume's mean rate at the cell's centre, times the chance that a hit is not missed.

The point-sensor formula diverges at the source, and a source lies anywhere in its cell. |u - s| is therefore clamped at
no less than `CENTRE_DISTANCE` cells: at the cell's centre the rate is then the mean over a cube of that size (the mean
of 1/r over a cube of side h, seen from its centre, is 2.38 / h). So a sensor beside the source neither kills the
source's own cell by missing nor by smelling more than its centre predicts.

Cells are as near to `cell` on each side as fits the volume. Moments add the variance within a cell, h^2 / 12 per axis.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from baselines.belief import grid_kernels
from baselines.belief.grid_information import compress, expected_information, poisson_tables
from baselines.belief.likelihood import HitModel
from osl_env.parameters import FloatArray

CENTRE_DISTANCE = 0.42  # cells: 1 / 2.38
NEGLIGIBLE = 1e-6  # mass that expectations may leave out (bound: see `grid_information`)


class GridBelief:
    """`n_beliefs` exact posteriors on one grid over `area` (3,), m, with cells of side `cell`, m.

    `use_model` comes before the first `update`. Memory: 16 bytes a cell and belief.
    """

    __slots__ = ("_points", "cell_variance", "log_posterior", "models", "probability", "size", "x", "y", "z")

    def __init__(self, area: FloatArray, *, cell: float = 2.0, n_beliefs: int = 1) -> None:
        counts = [max(1, round(float(length) / cell)) for length in area]
        self.size: FloatArray = np.asarray(area, dtype=np.float64) / counts  # (3,) m, sides of a cell
        self.x, self.y, self.z = (h * (np.arange(n) + 0.5) for h, n in zip(self.size, counts, strict=True))
        self.cell_variance: FloatArray = self.size**2 / 12.0  # (3,) m^2
        self.models: FloatArray = np.zeros((n_beliefs, 7))  # see grid_kernels.update
        n_cells = math.prod(counts)
        self.log_posterior: FloatArray = np.empty((n_beliefs, n_cells))
        self.probability: FloatArray = np.empty((n_beliefs, n_cells))
        self._points: FloatArray = np.empty((5, n_cells))
        self.reset()

    @property
    def n_cells(self) -> int:
        """Cells of one belief."""
        return int(self.log_posterior.shape[1])

    def reset(self, rows: Any = slice(None)) -> None:
        """Make the beliefs `rows` (all) uniform again."""
        self.log_posterior[rows] = -math.log(self.n_cells)
        self.probability[rows] = 1.0 / self.n_cells

    def use_model(self, model: HitModel, rows: Any = slice(None)) -> None:
        """Interpret the readings of the beliefs `rows` (all) by `model` from now on."""
        clamp = max(model.clamp_distance, CENTRE_DISTANCE * float(self.size.mean()))
        strength = model.strength * model.detection_probability
        self.models[rows] = (
            model.drift_x, model.drift_y, model.inverse_lambda, strength, clamp, model.background, model.max_count
        )  # fmt: skip

    def update(self, positions: FloatArray, readings: FloatArray, sampling_times: FloatArray) -> None:
        """Condition on M readings each: positions (B, M, 3) m, readings (B, M) hits, sampling_times (B, M) s.

        A sampling time of 0 (or less) means no reading.
        """
        grid_kernels.update(
            self.log_posterior,
            self.probability,
            self.x,
            self.y,
            self.z,
            np.ascontiguousarray(positions, dtype=np.float64),
            np.ascontiguousarray(readings, dtype=np.float64),
            np.ascontiguousarray(sampling_times, dtype=np.float64),
            self.models,
        )

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (B, 3), m, and covariance (B, 3, 3), m^2, of the source's position."""
        mean, covariance = np.empty((len(self.probability), 3)), np.empty((len(self.probability), 3, 3))
        grid_kernels.moments(self.probability, self.x, self.y, self.z, mean, covariance)
        covariance[:, (0, 1, 2), (0, 1, 2)] += self.cell_variance
        return mean, covariance

    def entropy(self) -> FloatArray:
        """(B,) nats, of the distribution over cells."""
        return np.asarray(-np.sum(self.probability * self.log_posterior, axis=1))

    def marginals(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The mass of each layer of cells across x (B, n_x), y (B, n_y) and z (B, n_z)."""
        n = len(self.probability)
        layers = np.empty((n, self.x.size)), np.empty((n, self.y.size)), np.empty((n, self.z.size))
        grid_kernels.marginals(self.probability, *layers)
        return layers

    def centre(self, cell: int) -> FloatArray:
        """(3,) m, the centre of the cell with index `cell`."""
        iz, rest = divmod(int(cell), self.x.size * self.y.size)
        iy, ix = divmod(rest, self.x.size)
        return np.array([self.x[ix], self.y[iy], self.z[iz]])

    def mode(self, belief: int = 0) -> FloatArray:
        """(3,) m, the centre of the likeliest cell (the first of equals)."""
        return self.centre(int(np.argmax(self.probability[belief])))

    def compressed(self, belief: int = 0, heavy: float = 0.0, negligible: float = NEGLIGIBLE) -> FloatArray:
        """(5, n): the belief as points for expectations; see `compress`."""
        rows = self.probability[belief], self.log_posterior[belief]
        n = compress(*rows, self.x, self.y, self.z, heavy, negligible, self._points)
        return np.ascontiguousarray(self._points[:, :n])  # rows of a view are not contiguous to numba: 5 times slower

    def information(
        self,
        candidates: FloatArray,
        sampling_times: tuple[float, ...],
        points: FloatArray | None = None,
        belief: int = 0,
    ) -> FloatArray:
        """Expected information, nats, of one reading at each of `candidates` (C, 3), m: (C, K).

        One column for each of `sampling_times`, s. `points` from `compressed` (default: every cell with mass).
        """
        points = self.compressed(belief) if points is None else points
        out = np.empty((len(candidates), len(sampling_times)))
        tables = poisson_tables(sampling_times)
        expected_information(points, candidates, self.models[belief], *tables, out)
        return out
