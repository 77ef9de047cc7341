"""Statistics against textbook values, limits and coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from osl_env.errors import InputError
from training.statistics import (
    bootstrap_mean,
    capped,
    compare_paired,
    holm,
    interquartile_mean,
    stratified_interquartile_mean,
    stratified_mean,
    wilcoxon,
    wilson,
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


def test_capping_puts_the_limit_in_place_of_failures() -> None:
    assert capped([10.0, 30.0, 50.0], [True, False, True], 40.0).tolist() == [10.0, 40.0, 40.0]


def test_interquartile_mean_ignores_the_outer_quarters() -> None:
    assert interquartile_mean([[-1e9, 1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 1e9]]) == pytest.approx(3.5)


def test_stratified_bootstrap_resamples_runs_within_a_task_only() -> None:
    tasks_differ_but_runs_do_not = np.tile([0.0, 10.0, 20.0, 30.0], (5, 1))
    assert stratified_interquartile_mean(tasks_differ_but_runs_do_not) == pytest.approx((15.0, 15.0, 15.0))
    with pytest.raises(InputError, match=r"\(runs, tasks\)"):
        stratified_interquartile_mean([1.0, 2.0])


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
