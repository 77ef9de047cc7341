"""How well a run mapped the gas and placed its source: the metrics of GaSLAM (eqs 11 to 14), and the truth for them.

    PE   = |declared - source|                                            (11)
    RMSE = sqrt(mean over cells of (map - truth)^2) / max truth           (12)
    SC   = share of the cells that map and truth both call gas, or both free of it     (13)
    M    = SC |1 - RMSE| / PE                                             (14)

The truth is the concentration at the centres of the cells, averaged over the time of the flight in the very episode
that was flown. Readings of ours: RMSE is over the truth's largest value (the paper states no normalisation); gas and no
gas in the truth as in the maps, by 2-means of each. A map without any gas scores well on RMSE and SC, because a plume
fills few cells: both mean something only beside that trivial map. M is of a table's averages, not an average of M: this
reproduces the published column.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from baselines.gaslam.cells import Cells
from baselines.gaslam.gaseous import gaseous
from baselines.policy import GasMap
from osl_env import InputError, Scenario, load_scenario
from osl_env.parameters import FloatArray
from training.plume_subjects import SimulatedPlume

INTERVAL = 0.5  # s: a tunnel's filaments move by a filament's width in it
FAILED_ALONG_X = 5.0  # m: a run with a larger error along x is failed, and left out of the paper's averages


def true_mean_map(
    scenario: str | Path | Scenario, seed: int, cells: Cells, seconds: float, interval: float = INTERVAL
) -> FloatArray:
    """(n,) mean concentration at the centres of `cells` in the first `seconds` of the episode (scenario, seed).

    In the plume's unit, sampled every `interval` s or the nearest number of the plume's ticks, and once where the plume
    does not change. A plume of hits gives its mean hit rate. Raises InputError for times that are not above 0.
    """
    for key, time in (("seconds", seconds), ("interval", interval)):
        if not (math.isfinite(time) and time > 0.0):
            raise InputError(f"true mean map: {key} = {time}: must be a finite time above 0 s")
    plume = SimulatedPlume(load_scenario(scenario), seed)
    if not plume.changes:
        return np.array(plume.readings(cells.centres))
    tick = plume.world.surroundings.tick
    between = max(1, round(interval / tick)) * tick  # the air goes on by whole ticks
    n = max(1, round(seconds / between))
    total = np.zeros(cells.n)
    for _ in range(n):
        plume.go_on(between)
        total += plume.readings(cells.centres)
    return total / n


def cells_of(gas_map: GasMap) -> Cells:
    """The cells of a belief's gas map; its values (nx, ny, nz) raveled are theirs (n,)."""
    nx, ny, nz = gas_map.values.shape
    return Cells(gas_map.low, gas_map.low + gas_map.spacing * (nx, ny, nz), (nx, ny, nz))


def rmse(gas_map: ArrayLike, truth: ArrayLike) -> float:
    """Root mean square error of a map (n,) over the largest value of the `truth` (n,)  (12).

    A truth without gas has no scale: then 0 if the map is the truth, and inf if not.
    """
    estimate, true = _alike(gas_map, truth)
    error = float(np.sqrt(np.mean((estimate - true) ** 2)))
    largest = float(true.max())
    if largest > 0.0:
        return error / largest
    return 0.0 if error == 0.0 else math.inf


def shape_coverage(gas_map: ArrayLike, truth: ArrayLike, floor: float = 0.0) -> float:
    """Share of cells that a map (n,) and the `truth` (n,) classify alike, each by its own 2-means  (13).

    Nothing up to `floor`, in the maps' unit, is gas.
    """
    estimate, true = _alike(gas_map, truth)
    return float(np.mean(gaseous(estimate, floor) == gaseous(true, floor)))


def position_error(declared: ArrayLike, sources: ArrayLike) -> float:
    """Distance, m, from the `declared` position (3,) to the nearest of `sources` (3,) or (k, 3)  (11)."""
    return float(np.linalg.norm(_nearest_offset(declared, sources)))


def is_failed(declared: ArrayLike, sources: ArrayLike, limit: float = FAILED_ALONG_X) -> bool:
    """Whether the error along x, m, from the nearest of `sources` is above `limit`: the paper leaves such runs out."""
    return bool(abs(_nearest_offset(declared, sources)[0]) > limit)


def merit(coverage: float, error: float, distance: float) -> float:
    """M of the shape `coverage` (SC), the root mean square `error` (RMSE) and the position error `distance`, m  (14).

    inf for a source that was met exactly; 0 where nothing is right, even then. Raises InputError for negative
    values, and for an `error` without a scale (inf).
    """
    for key, value in (("SC", coverage), ("RMSE", error), ("PE", distance)):
        if not value >= 0.0 or (math.isinf(value) and key != "PE"):
            raise InputError(f"merit: {key} = {value}: must be 0 or more{'' if key == 'PE' else ', and finite'}")
    likeness = coverage * abs(1.0 - error)
    if distance == 0.0:
        return math.inf if likeness > 0.0 else 0.0
    return likeness / distance


def _alike(gas_map: ArrayLike, truth: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Map and truth (n,), checked. Raises InputError for empty or different shapes, or for what is not finite."""
    estimate, true = np.asarray(gas_map, dtype=np.float64).ravel(), np.asarray(truth, dtype=np.float64).ravel()
    if estimate.shape != true.shape or estimate.size == 0:
        raise InputError(f"gas map of {estimate.size} cells, truth of {true.size}: must be the same number, 1 or more")
    if not (np.isfinite(estimate).all() and np.isfinite(true).all()):
        raise InputError("gas map and truth: must be finite in every cell")
    return estimate, true


def _nearest_offset(declared: ArrayLike, sources: ArrayLike) -> FloatArray:
    """(3,) m from the nearest of `sources` to the `declared` position."""
    place, true = np.asarray(declared, dtype=np.float64), np.atleast_2d(np.asarray(sources, dtype=np.float64))
    if place.shape != (3,) or true.ndim != 2 or true.shape[1] != 3 or len(true) == 0:
        raise InputError(f"declared position of shape {place.shape}, sources of {true.shape}: must be (3,) and (k, 3)")
    offsets = place - true
    nearest: FloatArray = offsets[np.argmin(np.linalg.norm(offsets, axis=1))]
    return nearest
