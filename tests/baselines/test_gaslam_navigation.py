"""GaSLAM's navigation (4) to (9) and the vote (10), against what can be worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm

from baselines.gaslam.declaration import Guesses, VoteParameters
from baselines.gaslam.navigation import (
    Differences,
    NavigationParameters,
    agreement,
    cell_to_explore,
    divergence,
    goal,
)
from osl_env.parameters import FloatArray

PAPER = NavigationParameters()
PRINTED = NavigationParameters(vectors="printed", difference="printed", tie_margin=0.0)
NOWHERE = np.empty((0, 3))
BINS = np.array([0.5, 0.2, 0.1])


def kld_by_hand(p: NavigationParameters, own: FloatArray, highest: float, mean: float, variance: float) -> float:
    """(6) for one cell, bin by bin."""
    measured, predicted = [], []
    for b in range(p.kld_bins):
        low, high = highest * b / p.kld_bins, highest * (b + 1) / p.kld_bins
        last = b == p.kld_bins - 1
        count = sum(1 for r in own if low <= r and (r < high or last))
        measured.append(count + p.kld_smoothing / p.kld_bins)
        top = 1.0 if last else norm.cdf(high, mean, math.sqrt(variance))
        bottom = 0.0 if b == 0 else norm.cdf(low, mean, math.sqrt(variance))
        predicted.append(max(top - bottom, p.kld_floor))
    share = np.array(measured) / sum(measured)
    return float(np.sum(share * np.log2(share / (np.array(predicted) / sum(predicted)))))


def test_divergence_is_the_sum_of_the_paper_over_the_bins_of_each_cell() -> None:
    rng = np.random.default_rng(0)
    p = NavigationParameters(kld_bins=7, kld_smoothing=0.5, kld_floor=0.01)
    cells, readings = rng.integers(0, 4, 50), rng.gamma(1.0, 30.0, 50)
    mean, variance = rng.uniform(0.0, 60.0, 5), rng.uniform(1.0, 900.0, 5)
    bits = divergence(p, cells, readings, mean, variance)
    for cell in range(5):  # nothing was read in the last
        own = readings[cells == cell]
        assert bits[cell] == pytest.approx(kld_by_hand(p, own, readings.max(), mean[cell], variance[cell]), rel=1e-9)


def test_divergence_is_never_negative_and_does_not_depend_on_the_unit() -> None:
    rng = np.random.default_rng(1)
    cells, readings = rng.integers(0, 20, 200), rng.gamma(1.0, 30.0, 200)
    mean, variance = rng.uniform(0.0, 60.0, 30), rng.uniform(0.0, 900.0, 30)
    bits = divergence(PAPER, cells, readings, mean, variance)
    assert bits.min() >= -1e-12  # Gibbs, up to rounding
    # a power of two, so that no reading changes its bin by rounding
    assert np.allclose(divergence(PAPER, cells, readings / 64, mean / 64, variance / 64**2), bits, rtol=1e-9)


def test_divergence_falls_with_every_reading_that_agrees_and_without_any_is_the_same_everywhere() -> None:
    mean, variance = np.full(3, 10.0), np.full(3, 1e-3)
    counts = (0, 1, 10)
    cells = np.repeat(np.arange(3), counts)
    bits = divergence(PAPER, np.append(cells, 2), np.append(np.full(len(cells), 10.0), 20.0), mean, variance)
    assert bits[0] > bits[1] > bits[2]
    empty = divergence(PAPER, np.empty(0, np.int64), np.empty(0), np.zeros(4), np.zeros(4))
    assert np.isfinite(empty).all()
    assert np.ptp(empty) == 0.0


def test_all_readings_zero_and_one_cell_are_defined() -> None:
    bits = divergence(PAPER, np.zeros(5, np.int64), np.zeros(5), np.zeros(1), np.zeros(1))
    assert np.isfinite(bits).all()
    assert cell_to_explore(PAPER, bits, np.zeros(1), np.zeros((1, 3)), np.zeros(3), NOWHERE) == 0


def test_unknown_cells_are_explored_first_and_the_nearest_of_equals() -> None:
    centres = np.array([[x + 0.5, 0.0, 0.0] for x in range(6)])
    confidence = np.array([0.0, 0.0, 0.9, 0.9, 0.0, 0.0])
    bits, here = np.ones(6), np.array([2.4, 0.0, 0.0])
    assert cell_to_explore(PAPER, bits, confidence, centres, here, NOWHERE) == 1
    assert cell_to_explore(PRINTED, bits, confidence, centres, here, NOWHERE) == 0
    # the floor: below it confidence does not count, but the KLD does
    bits[5] = 1.5
    assert cell_to_explore(PAPER, bits, confidence, centres, here, NOWHERE) == 5
    assert cell_to_explore(PRINTED, bits, np.array([1e-4, 0, 0, 0, 0, 1e-3]), centres, here, NOWHERE) == 5


def test_a_team_leaves_each_other_the_cells_that_are_nearer_to_them() -> None:
    centres = np.array([[x + 0.5, 0.0, 0.0] for x in range(6)])
    bits, unknown = np.ones(6), np.zeros(6)
    here, other = np.array([2.0, 0.0, 0.0]), np.array([[1.4, 0.0, 0.0]])
    assert cell_to_explore(PAPER, bits, unknown, centres, here, NOWHERE) == 1
    assert cell_to_explore(PAPER, bits, unknown, centres, here, other) == 2
    everywhere = centres.copy()  # nothing is nearer to this one: it goes to the nearest all the same
    assert cell_to_explore(PAPER, bits, unknown, centres, here + 0.1, everywhere) in (1, 2)


def test_alpha_is_the_root_of_the_share_that_the_plume_map_explains() -> None:
    kernel = np.array([True, True, True, True, False, False])
    assert agreement(kernel, np.array([True, False, False, False, True, True])) == 0.5
    assert agreement(kernel, kernel) == 1.0
    assert agreement(kernel, ~kernel) == 0.0
    assert agreement(np.zeros(6, np.bool_), np.ones(6, np.bool_)) == 0.0


def test_differences_are_visited_once_each_or_for_ever_the_greatest() -> None:
    kernel, plume = np.array([5.0, 9.0, 7.0, 1.0]), np.array([4.0, 4.0, 4.0, 50.0])
    gaseous = np.array([True, True, True, False])
    once, printed = Differences(PAPER, 4), Differences(PRINTED, 4)
    assert [once.next_cell(kernel, plume, gaseous) for _ in range(5)] == [1, 2, 0, 1, 2]
    assert [printed.next_cell(kernel, plume, gaseous) for _ in range(3)] == [1, 1, 1]
    assert once.next_cell(kernel, plume, np.zeros(4, np.bool_)) is None


def test_goal_is_between_exploring_and_exploiting() -> None:
    here, explore, exploit = np.array([1.0, 1.0, 0.2]), np.array([4.0, 1.0, 0.2]), np.array([1.0, 3.0, 0.2])
    assert np.allclose(goal(PAPER, here, explore, exploit, 0.0, 1.0), [2.0, 1.0, 0.2])
    assert np.allclose(goal(PAPER, here, explore, exploit, 1.0, 1.0), [1.0, 2.0, 0.2])
    assert np.allclose(goal(PAPER, here, explore, exploit, 0.25, 1.0), [1.75, 1.25, 0.2])
    assert np.allclose(goal(PAPER, here, explore, exploit, 1.0, 2.5), [1.0, 3.5, 0.2])
    assert np.allclose(goal(PAPER, here, explore, exploit, 1.0, 2.5, beyond=False), exploit)
    assert np.allclose(goal(PRINTED, here, explore, exploit, 0.25, 1.0), 0.75 * explore + 0.25 * exploit)


def test_goal_is_defined_where_vectors_cancel_or_vanish() -> None:
    here = np.array([2.0, 1.0, 0.2])
    aside = np.array([1.5, 0.0, 0.0])
    place = goal(PAPER, here, here - aside, here + aside, 0.5, 1.0)
    assert np.allclose(place, here - aside / 1.5)
    assert np.array_equal(goal(PAPER, here, here, here, 1.0, 1.0), here)
    assert np.array_equal(goal(PRINTED, here, here, here, 0.0, 1.0), here)


def test_goal_turns_with_the_world() -> None:
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    here, explore, exploit = rng.normal(size=(3, 3))
    for p in (PAPER, PRINTED):
        turned = goal(p, turn @ here, turn @ explore, turn @ exploit, 0.4, 0.7)
        assert np.allclose(turned, turn @ goal(p, here, explore, exploit, 0.4, 0.7), atol=1e-12)


def recorded(parameters: VoteParameters, guesses: list[tuple[tuple[float, float, float], float]]) -> Guesses:
    """`guesses` of place and entropy, all recorded."""
    out = Guesses(parameters)
    out.recording = True
    for place, entropy in guesses:
        out.take(np.array(place), entropy, 1.0)
    return out


def voted(parameters: VoteParameters, guesses: list[tuple[tuple[float, float, float], float]]) -> FloatArray:
    """The vote of `guesses`, all recorded."""
    place = recorded(parameters, guesses).vote(BINS)
    assert place is not None
    return place


def test_recording_begins_with_a_low_entropy_that_the_maps_agree_on_and_goes_on() -> None:
    guesses = Guesses(VoteParameters())
    guesses.take(np.zeros(3), 5.0, 1.0)
    guesses.take(np.zeros(3), 1.0, 0.0)
    assert not guesses.recording
    assert guesses.vote(BINS) is None
    guesses.take(np.zeros(3), 1.0, 0.3)
    guesses.take(np.ones(3), 5.0, 0.0)
    assert len(guesses) == 2


def test_the_vote_leaves_out_what_is_far_from_the_others() -> None:
    near = [((x, 1.0, 0.2), 1.0) for x in (0.4, 0.5, 0.6)]
    far = [((5.0, 1.0, 0.2), 0.0), ((5.1, 1.0, 0.2), 0.0)]
    assert np.allclose(voted(VoteParameters(), far + near), [0.5, 1.0, 0.2])
    # S_th of the paper's bins is 1.095 m
    assert np.allclose(voted(VoteParameters(), [((0.0, 0.0, 0.0), 1.0), ((1.09, 0.0, 0.0), 1.0)]), [0.545, 0.0, 0.0])
    assert np.allclose(voted(VoteParameters(), [((0.0, 0.0, 0.0), 1.0), ((1.10, 0.0, 0.0), 1.0)]), [0.0, 0.0, 0.0])


def test_weights_favour_the_sure_or_as_printed_the_unsure() -> None:
    guesses = [((0.0, 0.0, 0.0), 0.0), ((1.0, 0.0, 0.0), 0.9)]
    assert voted(VoteParameters(), guesses)[0] == pytest.approx((1.0 / 1.0) / (1.0 / 0.1 + 1.0 / 1.0))
    assert voted(VoteParameters(weighting="printed"), guesses)[0] == 1.0
    assert voted(VoteParameters(weighting="equal"), guesses)[0] == 0.5
    sure = [(place, 0.0) for place, _ in guesses]
    assert np.allclose(voted(VoteParameters(weighting="printed"), sure), [0.5, 0.0, 0.0])
