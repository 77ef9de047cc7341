"""Source term estimation: where the source may be and what it releases, from a gas map (GaSLAM eqs 2 and 3).

After Rahbar, Marjovi and Martinoli 2019. The posterior of the source term (see `source_model`) is sampled by
Metropolis-Hastings (see `metropolis`) from the cells of the map that are used: those that the flight has measured.

The prior is uniform. Its intervals are shares of what the mission knows, so that they fit any area and sensor:

    x_s, y_s, z_s   the box of the cells
    ay, az          `growth_y`, `growth_z`: metres of plume width a metre downwind
    by, bz          `width_y`, `width_z`: shares of the area's extent across the wind (in air at rest: of its shorter
                    side), and of its height
    Q               `release`: shares of the Q with which a plume of the largest by and bz starts at the full scale

Readings of ours where the paper is silent: those intervals; sigma_E is 0.03 of the sensor's scale, the paper's 30 on a
scale of 0 to 1000; the chain's entropy is taken over 14 x 10 x 5 bins of the box, the paper's 0.5 x 0.2 x 0.1 m. Cells
of a kernel map are correlated, and (3) counts them as independent: the posterior is narrower than the truth is known.

The paper's 1000 to 2000 iterations are those that are kept; 2000 are worth 25 to 40 independent draws of the source's
position in the paper's tunnel. Between two columns of cells the map hardly tells one x_s from another, and so sharp a
posterior has a mode for each: in about one map of fifteen, all walkers are in another one than most of the posterior.

Of several UAVs' maps, log likelihoods are summed by the number of maps that use a cell as its weight and the mean of
those maps as its reading. Without a used cell the posterior is the prior; readings that are all zero rule out the
sources whose gas would have been seen.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from pydantic import field_validator

from baselines.gaslam.cells import Cells
from baselines.gaslam.metropolis import Prior, Walk, log_densities, walk
from baselines.gaslam.source_model import SHAPE, Columns, bearing, columns_of, fill_plume, log_likelihoods
from osl_env.errors import InputError
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import IntArray

_ARCHIVE = 400  # states that steps are taken from
_ARCHIVED_EVERY = 2  # iterations
_FIRST_DRAWS = 200  # of the prior, of which a cold start takes the likeliest


class SourceTermParameters(Parameters):
    """Prior, likelihood and sampler. The defaults are the readings given above."""

    sensor_scale: float = quantity(1000.0, "unit of the reading", gt=0)  # full scale
    error: float = quantity(0.03, "", gt=0)  # sigma_E, in sensor scales
    release: tuple[float, float] = quantity((0.0, 1.0), "")  # of Q, see above
    growth_y: tuple[float, float] = quantity((0.0, 0.25), "")  # of ay
    growth_z: tuple[float, float] = quantity((0.0, 0.25), "")  # of az
    width_y: tuple[float, float] = quantity((0.04, 0.25), "")  # of by, in extents of the area across the wind
    width_z: tuple[float, float] = quantity((0.15, 0.5), "")  # of bz, in heights of the area
    minimum_speed: float = quantity(0.05, "m/s", gt=0)  # slower wind counts as this fast
    bins: tuple[int, int, int] = quantity((14, 10, 5), "")  # of the histogram of positions
    iterations: int = quantity(2000, "", ge=1)  # that are kept
    burn_in: int = quantity(500, "", ge=0)  # iterations after a warm start
    first_burn_in: int = quantity(2000, "", ge=0)  # iterations after a cold start
    temperature: float = quantity(10.0, "", ge=1)  # of the likelihood as the burn-in begins
    first_temperature: float = quantity(100.0, "", ge=1)
    walkers: int = quantity(4, "", ge=1, le=_FIRST_DRAWS)
    redraw: float = quantity(0.15, "", ge=0, lt=1)  # share of proposals that draw the position anew

    @field_validator("release", "growth_y", "growth_z", "width_y", "width_z")
    @classmethod
    def _interval(cls, interval: tuple[float, float]) -> tuple[float, float]:
        if not 0.0 <= interval[0] <= interval[1]:
            raise ValueError(f"{list(interval)}: must be two numbers >= 0, the first not above the second")
        return interval

    @field_validator("width_y", "width_z")
    @classmethod
    def _wide(cls, interval: tuple[float, float]) -> tuple[float, float]:
        if interval[0] <= 0.0:
            raise ValueError(f"{list(interval)}: must be above 0")
        return interval

    @field_validator("bins")
    @classmethod
    def _some(cls, bins: tuple[int, int, int]) -> tuple[int, int, int]:
        if min(bins) < 1:
            raise ValueError(f"{list(bins)}: must be at least 1 along each axis")
        return bins

    @property
    def sigma_e(self) -> float:
        """sigma_E in the reading's unit."""
        return self.error * self.sensor_scale


@dataclass(frozen=True, eq=False)
class Posterior:
    """A sampled posterior of the source term.

    Row k of the chain is of walker k modulo `walkers`: a walker's own chain is every `walkers`-th row.
    """

    chain: FloatArray  # (k, 8): Q (unit m^3/s), x_s, y_s, z_s (m), a_y, b_y (m), a_z, b_z (m)
    log_likelihood: FloatArray  # (k,), less that of no gas
    wind: FloatArray  # (3,) m/s
    low: FloatArray  # (3,) m, of the prior's box
    high: FloatArray  # (3,) m
    bins: tuple[int, int, int]
    walkers: int
    acceptance: FloatArray  # (3,): of redraws of the position, steps, jumps; 0 where there was no proposal
    scale: float  # the tuned length of a step

    @property
    def positions(self) -> FloatArray:
        """(k, 3) m of the source; a view."""
        return self.chain[:, 1:4]

    @functools.cached_property
    def mean(self) -> FloatArray:
        """(3,) m, of the position."""
        return np.asarray(self.positions.mean(axis=0))

    @functools.cached_property
    def covariance(self) -> FloatArray:
        """(3, 3) m^2, of the position."""
        centred = self.positions - self.mean
        return np.asarray(centred.T @ centred / len(centred))

    @property
    def best(self) -> FloatArray:
        """(8,) the likeliest source term of the chain: with a uniform prior, also the most probable."""
        likeliest: FloatArray = self.chain[int(np.argmax(self.log_likelihood))]
        return likeliest

    @property
    def bin_size(self) -> FloatArray:
        """(3,) m."""
        return np.asarray((self.high - self.low) / np.array(self.bins))

    @functools.cached_property
    def counts(self) -> IntArray:
        """(bins) the histogram of the positions."""
        place = ((self.positions - self.low) / self.bin_size).astype(np.int64)
        i, j, k = np.minimum(place, np.array(self.bins) - 1).T
        flat = (i * self.bins[1] + j) * self.bins[2] + k
        return np.bincount(flat, minlength=math.prod(self.bins)).reshape(self.bins)

    @functools.cached_property
    def entropy(self) -> float:
        """Nats, of the histogram: 0 if all is in one bin, at most the logarithm of the number of bins or rows."""
        share = self.counts[self.counts > 0] / len(self.chain)
        return max(float(-share @ np.log(share)), 0.0)


class SourceTerm:
    """Estimates the source term from maps over `cells`; keeps nothing between two calls."""

    def __init__(self, cells: Cells, parameters: SourceTermParameters | None = None) -> None:
        """Sources are within the box of `cells`."""
        self.cells = cells
        self.parameters = parameters or SourceTermParameters()

    def sample(
        self,
        mean: ArrayLike,
        use: ArrayLike,
        wind: ArrayLike,
        rng: np.random.Generator,
        start: Posterior | None = None,
    ) -> Posterior:
        """The posterior given the map's `mean` (n,) in the cells of positive `use` (n,), bool or weights.

        `wind` (3,) m/s. `start`, the posterior before, saves most of the burn-in. Raises InputError for wrong shapes,
        a negative weight, a used mean or a wind that is not finite.
        """
        own, air = self.parameters, _wind(wind)
        columns, prior = self._columns(mean, use, air), self.prior(air)
        if start is None:
            walkers, archive, filled, scale = self._cold(prior, columns, rng)
            how = Walk(own.first_burn_in, _ARCHIVED_EVERY, own.first_temperature, own.redraw)
        else:
            walkers, archive, filled, scale = self._warm(prior, start, rng)
            how = Walk(own.burn_in, _ARCHIVED_EVERY, own.temperature, own.redraw)
        chain, log_likelihood, tally = np.empty((own.iterations, 1 + SHAPE)), np.empty(own.iterations), np.zeros((3, 2))
        stream = np.uint64(rng.integers(2**64, dtype=np.uint64))
        state = (walkers, archive, filled, scale)
        scale = walk(stream, *state, prior, columns, how, chain, log_likelihood, tally)
        acceptance = tally[:, 1] / np.maximum(tally[:, 0], 1.0)
        box = (self.cells.low, self.cells.high, own.bins)
        return Posterior(chain, log_likelihood, air, *box, own.walkers, acceptance, scale)

    def prior(self, wind: ArrayLike) -> Prior:
        """The prior's intervals in `wind` (3,) m/s."""
        own, air = self.parameters, _wind(wind)
        direction, at_rest = bearing(air)
        extent = self.cells.high - self.cells.low
        across = abs(direction[0]) * extent[1] + abs(direction[1]) * extent[0]
        across = min(extent[0], extent[1]) if at_rest else across
        width_y, width_z = across * np.array(own.width_y), extent[2] * np.array(own.width_z)
        full = 2.0 * math.pi * self._carried(air) * own.sensor_scale * width_y[1] * width_z[1]
        box = zip(self.cells.low, self.cells.high, strict=True)
        intervals = [full * np.array(own.release), *box, own.growth_y, width_y, own.growth_z, width_z]
        low, high = np.array(intervals, dtype=np.float64).T
        return Prior(np.ascontiguousarray(low), high - low)

    def log_likelihood(self, sources: ArrayLike, mean: ArrayLike, use: ArrayLike, wind: ArrayLike) -> FloatArray:
        """(k,) logarithm of (3) of `sources` (k, 8), less that of no gas at all."""
        terms = _terms(sources)
        out = np.empty(len(terms))
        log_likelihoods(terms, self._columns(mean, use, _wind(wind)), out)
        return out

    def plume_map(self, source: ArrayLike, wind: ArrayLike) -> FloatArray:
        """(n,) eq 2 of `source` (8,) at the cells' centres in `wind` (3,) m/s, in the reading's unit."""
        term, air = _terms(source)[0], _wind(wind)
        n, nz = self.cells.n, self.cells.shape[2]
        columns = columns_of(self.cells, np.zeros(n), np.ones(n), air, self._carried(air))
        out = np.empty((nz, n // nz))
        fill_plume(term, columns, self._carried(air), np.empty((2, n // nz)), out)
        plume = np.empty((n // nz, nz))
        plume[columns.order] = out.T
        return plume.reshape(-1)

    def _carried(self, wind: FloatArray) -> float:
        """U, m/s."""
        return max(math.hypot(wind[0], wind[1]), self.parameters.minimum_speed)

    def _columns(self, mean: ArrayLike, use: ArrayLike, wind: FloatArray) -> Columns:
        readings, weight = np.asarray(mean, dtype=np.float64), np.asarray(use, dtype=np.float64)
        n = self.cells.n
        if readings.shape != (n,) or weight.shape != (n,):
            raise InputError(f"source term: mean, use have the shapes {readings.shape}, {weight.shape}: must be ({n},)")
        wrong = ~((weight >= 0.0) & (weight < np.inf) & (np.isfinite(readings) | (weight == 0.0)))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise InputError(
                f"source term: cell {k}: mean = {readings[k]}, use = {weight[k]}: must be finite, and use not below 0"
            )
        return columns_of(self.cells, readings, weight / self.parameters.sigma_e**2, wind, self._carried(wind))

    def _cold(
        self, prior: Prior, columns: Columns, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, int, float]:
        """Walkers, archive, its filled rows and g: walkers are the likeliest of some draws from the prior."""
        units = rng.random((_FIRST_DRAWS, SHAPE))
        density = np.empty(_FIRST_DRAWS)
        log_densities(units, prior, columns, density)
        likeliest = np.argsort(-density, kind="stable")[: self.parameters.walkers]
        archive = np.zeros((_ARCHIVE, SHAPE))
        archive[:_FIRST_DRAWS] = units
        return units[likeliest], archive, _FIRST_DRAWS, 1.0

    def _warm(
        self, prior: Prior, start: Posterior, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, int, float]:
        """The same out of the posterior before, moved into the present prior where that is another."""
        side = np.where(prior.side[1:] > 0.0, prior.side[1:], 1.0)
        filled = min(len(start.chain), _ARCHIVE)
        rows = np.linspace(0, len(start.chain) - 1, filled).astype(np.int64)
        archive = np.zeros((_ARCHIVE, SHAPE))
        archive[:filled] = np.clip((start.chain[rows, 1:] - prior.low[1:]) / side, 0.0, 1.0)
        walkers = archive[rng.integers(filled, size=self.parameters.walkers)]
        return walkers, archive, filled, start.scale


def _terms(sources: ArrayLike) -> FloatArray:
    """(k, 8) source terms, contiguous and checked."""
    terms = np.ascontiguousarray(np.atleast_2d(sources), dtype=np.float64)
    if terms.ndim != 2 or terms.shape[1] != 1 + SHAPE or not np.isfinite(terms).all():
        raise InputError(f"source term: sources of shape {terms.shape}: must be finite and (k, {1 + SHAPE})")
    growth, width = terms[:, [4, 6]], terms[:, [5, 7]]
    if not ((growth >= 0.0).all() and (width > 0.0).all()):
        raise InputError(f"source term: a_y, a_z >= {growth.min()}, b_y, b_z >= {width.min()}: must be >= 0 and > 0")
    return terms


def _wind(wind: ArrayLike) -> FloatArray:
    air = np.array(wind, dtype=np.float64)
    if air.shape != (3,) or not np.isfinite(air).all():
        raise InputError(f"source term: wind = {air.tolist()}: must be three finite numbers in m/s")
    return air
