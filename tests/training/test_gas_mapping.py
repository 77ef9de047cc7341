"""The metrics of gas maps: the published rows, their limits, and the truth of steady and of turbulent plumes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from baselines.gaslam.cells import Cells
from osl_env import InputError, Scenario, World, load_scenario
from training.gas_mapping import (
    cells_of,
    is_failed,
    merit,
    position_error,
    rmse,
    shape_coverage,
    true_mean_map,
)

PUBLISHED = {"A": (0.0486, 0.7321, 0.3732, 1.8663), "D": (0.0477, 0.8214, 0.3700, 2.1141)}  # RMSE, SC, PE, M


def tunnel(**changes: Any) -> Scenario:
    """GaSLAM's tunnel, case C: at 0.7 m/s its plume is there after 15 s."""
    return load_scenario("tunnel-c", **changes)


def cells_in(scenario: Scenario) -> Cells:
    return Cells(np.zeros(3), np.array(scenario.arena.size))


# --- metrics


@pytest.mark.parametrize("case", PUBLISHED)
def test_merit_of_the_published_averages_is_the_published_one(case: str) -> None:
    """To the last digit printed, half of 1e-4; the printed factors' own rounding moves M by 3e-4 at most."""
    error, coverage, distance, published = PUBLISHED[case]
    assert merit(coverage, error, distance) == pytest.approx(published, abs=1e-4)


def test_merit_at_its_limits() -> None:
    assert merit(0.9, 0.1, 0.0) == math.inf
    assert merit(0.0, 0.1, 0.0) == merit(0.9, 1.0, 0.0) == 0.0
    assert merit(0.9, 0.1, math.inf) == 0.0
    for wrong in ((-0.1, 0.1, 1.0), (0.5, math.nan, 1.0), (0.5, math.inf, 1.0), (0.5, 0.1, -1.0)):
        with pytest.raises(InputError, match=r"^merit: (SC|RMSE|PE) = "):
            merit(*wrong)


def test_the_truth_itself_is_perfect() -> None:
    truth = np.random.default_rng(0).exponential(50, 700)
    assert rmse(truth, truth) == 0.0
    assert shape_coverage(truth, truth) == 1.0


def test_rmse_is_over_the_truths_maximum_and_knows_no_unit() -> None:
    truth, gas_map = np.array([0.0, 0.0, 3.0, 4.0]), np.array([0.0, 2.0, 3.0, 2.0])
    assert rmse(gas_map, truth) == pytest.approx(math.sqrt(8 / 4) / 4, rel=1e-14)
    assert rmse(1e3 * gas_map, 1e3 * truth) == pytest.approx(rmse(gas_map, truth), rel=1e-12)
    assert rmse(truth + 0.4, truth) == pytest.approx(0.1, rel=1e-12)


def test_a_truth_without_gas() -> None:
    clean = np.zeros(5)
    assert rmse(clean, clean) == 0.0
    assert rmse(np.ones(5), clean) == math.inf
    assert shape_coverage(clean, clean) == 1.0
    assert shape_coverage(np.array([0.0, 0, 0, 0, 9]), clean) == 0.8


def test_no_gas_anywhere_covers_all_but_the_plume() -> None:
    """100 of 700 cells hold gas: nothing covers the other 600, everything the 100, the opposite nothing."""
    truth = np.zeros(700)
    truth[300:400] = 50.0
    assert shape_coverage(np.zeros(700), truth) == pytest.approx(600 / 700)
    assert shape_coverage(np.full(700, 50.0), truth) == pytest.approx(100 / 700)
    assert shape_coverage(50.0 - truth, truth) == 0.0
    assert rmse(np.zeros(700), truth) == pytest.approx(math.sqrt(1 / 7), rel=1e-12)


def test_no_gas_anywhere_in_the_tunnel_scores_as_the_paper_page_says() -> None:
    """SC of 0.91 to 0.95 and RMSE of 0.10 to 0.12, over A to D; a case's own figure lies within a few hundredths."""
    scenario = tunnel()
    truth = true_mean_map(scenario, 1, cells_in(scenario), 60)
    nothing = np.zeros_like(truth)
    assert 0.88 < shape_coverage(nothing, truth, 5.0) < 0.98
    assert 0.07 < rmse(nothing, truth) < 0.15


def test_the_floor_keeps_noise_from_counting_as_gas() -> None:
    truth = np.where(np.arange(100) < 10, 200.0, 0.0)
    noise = np.random.default_rng(0).uniform(0, 4, 100)
    assert shape_coverage(noise, truth, 5.0) == pytest.approx(0.9)
    assert shape_coverage(noise, truth) < 0.7


@pytest.mark.parametrize(
    ("gas_map", "truth"), [([1.0], [1.0, 2.0]), ([], []), ([math.nan], [1.0]), ([1.0], [math.inf])]
)
def test_maps_that_cannot_be_compared_are_refused(gas_map: list[float], truth: list[float]) -> None:
    for metric in (rmse, shape_coverage):
        with pytest.raises(InputError, match="gas map"):
            metric(gas_map, truth)


def test_the_position_error_is_to_the_nearest_source() -> None:
    assert position_error((1, 2, 3), (1, 2, 3)) == 0.0
    assert position_error((0, 0, 0), (2, 3, 6)) == 7.0
    assert position_error((0, 0, 0), [(2, 3, 6), (0, -1, 0)]) == 1.0
    assert not is_failed((5, 9, 9), (0, 0, 0))
    assert is_failed((5.01, 0, 0), (0, 0, 0))
    assert is_failed((-5.01, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="declared position"):
        position_error((1, 2), (1, 2, 3))


# --- the truth


STEADY: dict[str, Any] = {
    "plume": {"kind": "pseudo_gaussian", "release_rate": 0.5, "width_y": 0.15},
    "gas_sensor": {"kind": "ideal"},
}


def test_the_true_map_of_a_steady_plume_is_the_model() -> None:
    scenario = tunnel(**STEADY)
    cells = cells_in(scenario)
    truth = true_mean_map(scenario, 1, cells, 60)
    x, y, z = (cells.centres - scenario.sources.positions[0]).T
    sy, sz = 0.1 * x + 0.15, 0.1 * x + 0.1
    with np.errstate(all="ignore"):
        model = 0.5 / (2 * np.pi * 0.7 * sy * sz) * np.exp(-(y**2) / (2 * sy**2) - z**2 / (2 * sz**2))
    np.testing.assert_allclose(truth, np.where(x >= 0, model, 0.0), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(true_mean_map(scenario, 1, cells, 5), truth)


def test_the_true_map_is_the_mean_of_the_episodes_own_plume() -> None:
    scenario = tunnel()
    cells = cells_in(scenario)
    world = World(scenario)
    world.reset([7])
    total = np.zeros(cells.n)
    for _ in range(12):
        world.run_air(0.5)
        total += world.concentration(0, cells.centres)
    np.testing.assert_array_equal(true_mean_map(scenario, 7, cells, 6), total / 12)
    assert rmse(true_mean_map(scenario, 8, cells, 6), total / 12) > 0.01  # another episode, another plume


def test_the_true_map_of_filaments_converges_with_time() -> None:
    """Two episodes' maps differ by chance alone: over 16 times the time by a quarter, within 30 % either way."""
    scenario = tunnel()
    cells = cells_in(scenario)
    apart = [
        np.mean([rmse(true_mean_map(scenario, seed, cells, t), true_mean_map(scenario, seed + 1, cells, t))
                 for seed in (1, 3, 5)])
        for t in (15, 240)
    ]  # fmt: skip
    assert apart[1] / apart[0] == pytest.approx(0.25, rel=0.3)


def test_the_true_map_does_not_depend_on_the_interval() -> None:
    """Filaments pass a cell's centre within a fraction of a second: 0.1 and 0.5 s sample the same mean."""
    scenario = tunnel()
    cells = cells_in(scenario)
    assert rmse(true_mean_map(scenario, 1, cells, 60, 0.1), true_mean_map(scenario, 1, cells, 60)) < 0.02
    least = true_mean_map(scenario, 1, cells, 1, 1e-3)  # no less than a tick of the plume
    np.testing.assert_array_equal(least, true_mean_map(scenario, 1, cells, 1, 0.1))


@pytest.mark.parametrize("key", ["seconds", "interval"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_impossible_times_are_refused(key: str, value: float) -> None:
    with pytest.raises(InputError, match=f"true mean map: {key} = "):
        true_mean_map("tunnel-c", 0, Cells(np.zeros(3), np.ones(3)), **{"seconds": 1.0, key: value})


def test_the_cells_of_a_beliefs_map_are_those_it_was_made_from() -> None:
    cells = Cells(np.array([1.0, 2, 3]), np.full(3, 4.0), (3, 4, 5))
    again = cells_of(cells.gas_map(np.arange(60.0)))
    assert again.shape == cells.shape
    np.testing.assert_allclose(again.centres, cells.centres, rtol=1e-14)
