"""Where GaSLAM flies to next: between what is unknown and what the source's estimate says.

    V_goal = (1 - alpha) V_explore + alpha V_exploit                                                    (4)
    V_explore  towards argmax_i KLD_i / c_i                                                             (5)
    KLD_i    = sum_b P_b log2(P_b / Q_b): P the readings of cell i, Q the ones that are predicted for it  (6)
    V_exploit  towards the source's estimate; once its entropy is low and guesses are recorded, towards
               argmax |kernel map - plume map| among the cells that both call gaseous                   (8)
    alpha    = sqrt(N_g / N_kg): cells gaseous in both maps / in the kernel map; 0 without any          (9)

Readings of ours, each with the parameter that restores the printed form:

    P          the histogram of the cell's readings over `kld_bins` from 0 to the highest of all, smoothed by a count of
               `kld_smoothing` that is spread over the bins: flat where nothing was read. Q: the Gaussian of the kernel
               map's mean and variance in that cell, its mass over each bin, at least `kld_floor`
    c          at least `least_confidence`. Cells without readings then differ little, and the first in the numbering of
               the cells would win: of the cells within `tie_margin` of the highest the nearest is taken, and of those
               first the ones to which none of the others heard of is nearer (0: the highest, as printed)
    vectors    "unit": V_explore and V_exploit are unit vectors times `goal_distance`, so that the UAV flies past what
               is nearer; not so on legs, which sample at their end alone. "printed": from the UAV to the targets
    difference "once": a cell that was the target of (8) is no target again before all others were. As "printed" it is a
               limit cycle: the difference remains where it is largest, and the UAV hovers there
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import BoolArray

_NONE = 1e-9  # m: a vector that leads nowhere


class NavigationParameters(Parameters):
    """Parameters of the navigation; mixed into the parameters of the policy."""

    kld_bins: int = quantity(20, "", ge=1, le=1000)
    kld_smoothing: float = quantity(1.0, "", gt=0)  # readings
    kld_floor: float = quantity(1e-3, "", gt=0, lt=1)
    least_confidence: float = quantity(0.02, "", gt=0, le=1)
    tie_margin: float = quantity(0.1, "", ge=0, lt=1)  # share of the highest
    vectors: Literal["unit", "printed"] = "unit"
    difference: Literal["once", "printed"] = "once"


def divergence(
    parameters: NavigationParameters,
    cells: NDArray[np.int64],
    readings: FloatArray,
    mean: FloatArray,
    variance: FloatArray,
) -> FloatArray:
    """KLD (n,) of every cell, bits (6).

    `cells` (m,): where the `readings` (m,) were taken; `mean`, `variance` (n,): of the kernel map.
    """
    n, bins = len(mean), parameters.kld_bins
    highest = float(readings.max(initial=0.0)) or 1.0
    which = np.clip((readings * (bins / highest)).astype(np.int64), 0, bins - 1)
    counts = np.bincount(cells * bins + which, minlength=n * bins).reshape(n, bins) + parameters.kld_smoothing / bins
    measured = counts / counts.sum(axis=1, keepdims=True)
    edges = np.linspace(0.0, highest, bins + 1)
    edges[0], edges[-1] = -math.inf, math.inf
    deviation = np.maximum(np.sqrt(variance), highest * 1e-6)  # 0: all in the bin of the mean
    below = ndtr((edges - mean[:, None]) / deviation[:, None])
    predicted = np.maximum(np.diff(below, axis=1), parameters.kld_floor)
    predicted /= predicted.sum(axis=1, keepdims=True)
    bits: FloatArray = (measured * np.log2(measured / predicted)).sum(axis=1)
    return bits


def cell_to_explore(
    parameters: NavigationParameters,
    bits: FloatArray,
    confidence: FloatArray,
    centres: FloatArray,
    here: FloatArray,
    others: FloatArray,
) -> int:
    """The cell of (5) for a UAV at `here` (3,) m, with `others` at (k, 3) m.

    `bits` (n,): the KLD; `centres` (n, 3) m. Of equals the first.
    """
    worth = bits / np.maximum(confidence, parameters.least_confidence)
    best = float(worth.max())
    if parameters.tie_margin == 0.0 or best <= 0.0:
        return int(np.argmax(worth))
    equals = np.flatnonzero(worth >= (1.0 - parameters.tie_margin) * best)
    distance = np.linalg.norm(centres[equals] - here, axis=1)
    if len(others):
        theirs = np.linalg.norm(centres[equals, None] - others[None], axis=2).min(axis=1)
        if (distance <= theirs).any():
            distance = np.where(distance <= theirs, distance, math.inf)
    return int(equals[np.argmin(distance)])


def agreement(kernel_gas: BoolArray, plume_gas: BoolArray) -> float:
    """Alpha, in [0, 1] (9), from the cells (n,) that are gaseous in the kernel map and in the plume map."""
    gaseous = int(np.count_nonzero(kernel_gas))
    return math.sqrt(int(np.count_nonzero(kernel_gas & plume_gas)) / gaseous) if gaseous else 0.0


class Differences:
    """The targets of (8) where guesses are recorded, one after another."""

    __slots__ = ("_once", "_seen")

    def __init__(self, parameters: NavigationParameters, n: int) -> None:
        """For a map of `n` cells."""
        self._once, self._seen = parameters.difference == "once", np.zeros(n, np.bool_)

    def next_cell(self, kernel: FloatArray, plume: FloatArray, gaseous: BoolArray) -> int | None:
        """The next target by the two maps (n,), among the cells (n,) that both call gaseous; None without any."""
        if not gaseous.any():
            return None
        open_to = gaseous & ~self._seen if self._once else gaseous
        if not open_to.any():
            self._seen[:] = False
            open_to = gaseous
        cell = int(np.argmax(np.where(open_to, np.abs(kernel - plume), -1.0)))
        self._seen[cell] = True
        return cell


def goal(
    parameters: NavigationParameters,
    here: FloatArray,
    explore: FloatArray,
    exploit: FloatArray,
    alpha: float,
    distance: float,
    beyond: bool = True,
) -> FloatArray:
    """The place `here` + V_goal (3,), m (4), `distance` being that of unit vectors, m; in bounds or not.

    `beyond`: whether a unit vector may lead past a target that is nearer. Where the two vectors cancel, the goal is
    that of the greater one, as in (4) for alpha = 0 or 1.
    """
    outward = _vector(parameters, explore - here, distance, beyond)
    inward = _vector(parameters, exploit - here, distance, beyond)
    vector = (1.0 - alpha) * outward + alpha * inward
    if float(np.linalg.norm(vector)) <= _NONE:
        vector = outward if alpha <= 0.5 else inward
    place: FloatArray = here + vector
    return place


def _vector(parameters: NavigationParameters, offset: FloatArray, distance: float, beyond: bool) -> FloatArray:
    length = float(np.linalg.norm(offset))
    if parameters.vectors == "printed" or length <= (_NONE if beyond else distance):
        return offset
    return offset * (distance / length)
