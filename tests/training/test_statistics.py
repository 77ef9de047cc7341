"""Statistics against textbook values, limits and coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from osl_env.errors import InputError
from training.statistics import (
    aggregates,
    bootstrap_mean,
    capped,
    compare_paired,
    compare_successes,
    holm,
    interquartile_mean,
    performance_profile,
    stratified_interquartile_mean,
    stratified_mean,
    wilcoxon,
    wilson,
    wins,
)


def test_wilson_matches_its_formula() -> None:
    z, k, n = 1.959963984540054, 15, 20
    centre = (k + z * z / 2) / (n + z * z)
    half = z / (n + z * z) * math.sqrt(k * (n - k) / n + z * z / 4)
    assert wilson(k, n) == pytest.approx((0.75, centre - half, centre + half), rel=1e-12)


@pytest.mark.parametrize(("k", "low", "high"), [(0, 0.0, 0.2775), (10, 0.7225, 1.0)])
def test_wilson_at_none_and_all_of_ten(k: int, low: float, high: float) -> None:
    estimate = wilson(k, 10)
    assert estimate == pytest.approx((k / 10, low, high), abs=1e-4)
    assert math.isnan(wilson(0, 0).value)


def test_bootstrap_mean_covers_the_mean_nineteen_times_in_twenty() -> None:
    rng = np.random.default_rng(1)
    truth, trials = 2.0, 100
    covered = 0
    for trial in range(trials):
        estimate = bootstrap_mean(rng.exponential(truth, 40), seed=trial)
        covered += estimate.low <= truth <= estimate.high
    # nominal 95; a skewed law and n = 40 cost a few per cent: 4 standard errors (2.2 each) below 93
    assert covered >= 84


def test_bootstrap_mean_is_reproducible_and_leaves_nan_out() -> None:
    values = [1.0, 2.0, 5.0, 9.0]
    assert bootstrap_mean(values) == bootstrap_mean([*values, math.nan])
    assert bootstrap_mean([3.0, 3.0, 3.0]) == (3.0, 3.0, 3.0)
    assert math.isnan(bootstrap_mean([]).value)
    assert math.isnan(bootstrap_mean([4.0]).low)


def test_bootstrap_interval_is_scipys() -> None:
    sample = np.random.default_rng(4).exponential(5.0, 200)
    theirs = stats.bootstrap((sample,), np.mean, n_resamples=20_000, rng=np.random.default_rng(1)).confidence_interval
    # an end is a 2.5 % quantile of 9999 draws (standard error 2.7 % of the draws' deviation of 0.35), shifted by twice
    # the bias (2.5 %); theirs likewise, over the root of 2: 4.5 % together
    assert bootstrap_mean(sample)[1:] == pytest.approx((theirs.low, theirs.high), abs=4 * 0.045 * 0.35)


def test_large_samples_are_drawn_in_batches() -> None:
    sample = np.random.default_rng(5).normal(3.0, 1.0, 5000)
    mean, low, high = bootstrap_mean(sample)
    assert (low - mean, high - mean) == pytest.approx((-1.96 / 5000**0.5, 1.96 / 5000**0.5), rel=0.1)


def test_capping_puts_the_limit_in_place_of_failures() -> None:
    assert capped([10.0, 30.0, 50.0], [True, False, True], 40.0).tolist() == [10.0, 40.0, 40.0]


def test_interquartile_mean_ignores_the_outer_quarters() -> None:
    assert interquartile_mean([[-1e9, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 1e9]]) == pytest.approx(3.5)


def test_stratified_bootstrap_resamples_runs_within_a_task_only() -> None:
    tasks_differ_but_runs_do_not = np.tile([0.0, 10.0, 20.0, 30.0], (5, 1))
    assert stratified_interquartile_mean(tasks_differ_but_runs_do_not) == pytest.approx((15.0, 15.0, 15.0))
    with pytest.raises(InputError, match=r"\(runs, tasks\)"):
        stratified_interquartile_mean([1.0, 2.0])


def test_aggregates_of_a_matrix_by_hand() -> None:
    scores = np.array([[1.0, 10.0, 100.0], [3.0, 30.0, 100.0]])
    estimates = aggregates(scores)
    assert estimates["mean"].value == pytest.approx(244 / 6)
    assert estimates["median_of_tasks"].value == pytest.approx(20.0)  # of 2, 20 and 100
    assert estimates["interquartile_mean"].value == pytest.approx(
        (3 + 10 + 30 + 100) / 4
    )  # a quarter of six, rounded down, cut at each end
    assert all(estimate.low <= estimate.value <= estimate.high for estimate in estimates.values())


def test_performance_profile_counts_what_is_strictly_below() -> None:
    profile = performance_profile([[1.0, 2.0, 3.0, math.inf], [1.0, math.inf]], [1.0, 2.5, 20.0])
    assert profile.share == pytest.approx([0.0, (2 / 4 + 1 / 2) / 2, (3 / 4 + 1 / 2) / 2])
    assert np.all(profile.low <= profile.share)
    assert np.all(profile.share <= profile.high)
    assert np.all(np.diff(profile.low) >= 0)
    for bad in ([], [[]]):
        with pytest.raises(InputError, match="performance profile"):
            performance_profile(bad, [1.0])


def test_profile_bands_have_the_width_of_a_binomial() -> None:
    profile = performance_profile([np.arange(400) < 100], [0.5], resamples=4000)
    half = 1.96 * math.sqrt(0.75 * 0.25 / 400)
    assert (profile.low[0], profile.high[0]) == pytest.approx((0.75 - half, 0.75 + half), abs=0.005)


def test_wins_count_ties_half() -> None:
    assert wins([1.0, 2.0, 3.0], [2.0, 2.0, 2.0]).tolist() == [1.0, 0.5, 0.0]


def test_mcnemar_counts_discordant_pairs_only() -> None:
    first, second = [1, 1, 1, 1, 1, 1, 0, 1], [0, 0, 0, 0, 0, 1, 0, 1]
    comparison = compare_successes(first, second)
    assert comparison.p_value == pytest.approx(2 * 0.5**5)  # five pairs for the first, none for the second
    assert comparison.difference.value == pytest.approx(5 / 8)
    assert compare_successes(first, first).p_value == 1.0


def test_sign_flips_of_many_pairs_are_scipys() -> None:
    differences = np.random.default_rng(6).normal(0.15, 1.0, 60)
    theirs = stats.permutation_test(
        (differences,),
        np.mean,
        permutation_type="samples",
        vectorized=True,
        n_resamples=20_000,
        rng=np.random.default_rng(7),
    ).pvalue
    ours = compare_paired(differences, np.zeros(60)).p_value
    assert ours == pytest.approx(theirs, abs=4 * math.sqrt(0.25 / 20_000))  # four standard errors at the most


def test_paired_permutation_is_exact_for_few_pairs() -> None:
    comparison = compare_paired([2.0, 3.0, 4.0, 5.0], [1.0, 1.0, 1.0, 1.0])
    assert comparison.p_value == pytest.approx(2 / 2**4)  # only all signs equal are as extreme
    assert comparison.difference.value == pytest.approx(2.5)


def test_paired_comparison_of_the_same_sample_finds_nothing() -> None:
    sample = [1.0, 5.0, 2.0]
    assert compare_paired(sample, sample).p_value == 1.0
    assert wilcoxon(sample, sample) == 1.0
    with pytest.raises(InputError, match="paired samples"):
        compare_paired([1.0], [1.0, 2.0])


def test_paired_tests_agree_on_a_clear_difference() -> None:
    rng = np.random.default_rng(2)
    base = rng.normal(0.0, 5.0, 40)
    shifted = base + rng.normal(1.0, 0.5, 40)
    assert compare_paired(shifted, base).p_value < 1e-3
    assert wilcoxon(shifted, base) < 1e-3


def test_stratified_mean_weighs_strata_alike_and_resamples_inside_them() -> None:
    assert stratified_mean([np.full(10, 1.0), np.full(1000, 3.0)]) == pytest.approx((2.0, 2.0, 2.0))
    assert math.isnan(stratified_mean([]).value)


def test_holm_textbook_example() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    adjusted = holm([0.01, math.nan, 0.5])
    assert adjusted[0] == pytest.approx(0.02)
    assert math.isnan(adjusted[1])
    assert adjusted[2] == pytest.approx(0.5)
