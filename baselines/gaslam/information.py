"""Information-driven navigation of source term estimation: the candidate whose reading would teach most of the source.

After F. Rahbar, A. Marjovi and A. Martinoli, "An algorithm for odor source localization based on source term
estimation", ICRA 2019 (extended: "Design and performance evaluation of an algorithm based on source term estimation for
odor source localization", Sensors 19(3), 656, 2019). Neither text was at hand. What is known of it is their abstracts
(navigation after partially observable Markov decision processes, a balance of exploration and exploitation), what
GaSLAM says of it, and how the authors' own controller works, dated January 2019 and published with W. Jin, F. Rahbar,
C. Ercolani and A. Martinoli, ICRA 2023 (github.com/WantingJIN/DDPM_STE_GSL): nothing of it was copied. It says:

    candidates  places a step of 0.5 m from the robot, all in one plane; those outside the area are left out
    KLD         of the posterior with a further reading in the candidate from the posterior without:
                sum p' log(p' / p), over all parameters of the source; the greatest wins
    goal        here + r (candidate - here) + (1 - r) (source - here), r = 0.5 where nothing else is set (`exploration`;
                1: the candidate itself), source being the likeliest one (`estimate = "best"`). That this was the
                navigation of 2019 is inferred: the controller as published later calls another mix of the two

Readings of ours. Candidates are the four along x and y; the controller takes the four diagonals and the present place
too (`candidates = "eight"`, without the present place). UAVs fly in a volume: up and
down are added where it has room for them (`vertical`). The controller predicts one reading, that of the expected source
term, and samples the new posterior from the beginning (`predicted = "estimate"` takes that one reading). Here each of
`predictions` samples of the posterior predicts a reading, the new posterior is the same samples weighted by the
likelihood of that reading, exp(-(D - C)^2 / (2 sigma_E^2)), and the KLD is its average over the readings. Of equal
candidates one is drawn. Not taken over: the robot stops to measure for some 10 s at each goal and uses nothing that it
smells between two; of several robots each counts on the readings that the others will take at their goals.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numba import njit

from baselines.gaslam.source_model import Columns, bearing, fill_plume
from osl_env.parameters import FloatArray, Parameters, quantity

_EQUAL = 1e-9  # nats


class InformationParameters(Parameters):
    """Parameters of the navigation; mixed into the parameters of the policy."""

    step: float = quantity(0.5, "m", gt=0)  # to a candidate, in the paper's volume
    vertical_step: float = quantity(0.1, "m", gt=0)  # up or down, in the paper's volume
    candidates: Literal["four", "eight"] = "four"  # in the plane
    vertical: bool = True  # up and down as well
    predicted: Literal["samples", "estimate"] = "samples"
    predictions: int = quantity(200, "", ge=2, le=2000)  # samples of the posterior
    exploration: float = quantity(0.5, "", ge=0, le=1)  # r


def around(
    parameters: InformationParameters, here: FloatArray, low: FloatArray, high: FloatArray, scale: float
) -> FloatArray:
    """The candidates (m, 3), m, of a UAV at `here` (3,) that are within the box from `low` to `high` (3,), m.

    Lengths stated for the paper's volume are multiplied by `scale`.
    """
    steps = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]
    if parameters.candidates == "eight":
        steps += [(1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0)]
    if parameters.vertical:
        steps += [(0, 0, 1), (0, 0, -1)]
    lengths = scale * np.array([parameters.step, parameters.step, parameters.vertical_step])
    places = here + np.array(steps) * lengths
    return np.asarray(places[((places >= low) & (places <= high)).all(axis=1)])


@njit(cache=True, error_model="numpy")
def _plumes(sources: FloatArray, columns: Columns, carried: float, out: FloatArray) -> None:
    """Write eq 2 of each of `sources` (k, 8) at the places of `columns` to `out` (k, nz, c)."""
    scratch = np.empty((2, columns.downwind.size))
    for k in range(sources.shape[0]):
        fill_plume(sources[k], columns, carried, scratch, out[k])


def predictions(sources: FloatArray, places: FloatArray, wind: FloatArray, minimum_speed: float) -> FloatArray:
    """(k, m) readings that `sources` (k, 8) give at `places` (m, 3), m, in `wind` (3,) m/s by GaSLAM (2).

    Slower wind than `minimum_speed`, m/s, counts as that fast.
    """
    direction, at_rest = bearing(wind)
    downwind = places[:, :2] @ direction
    across = places[:, 1] * direction[0] - places[:, 0] * direction[1]
    order = np.argsort(downwind, kind="stable")
    heights, level = np.unique(places[:, 2], return_inverse=True)
    unweighted = np.zeros((len(heights), len(places)))
    columns = Columns(downwind[order], across[order], heights, unweighted, unweighted, direction, at_rest, order)
    out = np.empty((len(sources), len(heights), len(places)))
    carried = max(math.hypot(wind[0], wind[1]), minimum_speed)
    _plumes(np.ascontiguousarray(sources), columns, carried, out)
    readings = np.empty((len(sources), len(places)))
    readings[:, order] = out[:, level.reshape(-1)[order], np.arange(len(places))]
    return readings


def expected_divergence(predicted: FloatArray, outcomes: FloatArray, sigma: float) -> FloatArray:
    """(m,) nats: KLD of the posterior after a reading from that before, averaged over readings, for m candidates.

    `predicted` (k, m): the readings that k equally likely samples predict; `outcomes` (o, m): those that are averaged
    over; `sigma`: the error of a reading, all in its unit. Between 0 and log k.
    """
    k = len(predicted)
    divergence = np.empty(predicted.shape[1])
    for m in range(len(divergence)):
        exponent = -0.5 * ((outcomes[:, m, None] - predicted[None, :, m]) / sigma) ** 2  # (o, k)
        exponent -= exponent.max(axis=1, keepdims=True)
        weight = np.exp(exponent)
        total = weight.sum(axis=1)
        nats = (weight * exponent).sum(axis=1) / total - np.log(total / k)
        divergence[m] = nats.mean()
    return divergence


def most_informative(
    parameters: InformationParameters,
    chain: FloatArray,
    places: FloatArray,
    wind: FloatArray,
    minimum_speed: float,
    sigma: float,
) -> FloatArray:
    """(m,) nats: what a reading at each of `places` (m, 3), m, is expected to teach, given the posterior's `chain`.

    `chain` (n, 8): equally likely source terms; `wind` (3,) m/s; `sigma`: sigma_E in the reading's unit.
    """
    rows = np.linspace(0, len(chain) - 1, min(parameters.predictions, len(chain))).astype(np.int64)
    predicted = predictions(chain[rows], places, wind, minimum_speed)
    outcomes = predicted
    if parameters.predicted == "estimate":
        outcomes = predictions(chain.mean(axis=0, keepdims=True), places, wind, minimum_speed)
    return expected_divergence(predicted, outcomes, sigma)


def choose(nats: FloatArray, rng: np.random.Generator) -> int:
    """The candidate of the greatest of `nats` (m,); of equals one that is drawn."""
    best = np.flatnonzero(nats >= nats.max() - _EQUAL)
    return int(best[0] if best.size == 1 else best[rng.integers(best.size)])
