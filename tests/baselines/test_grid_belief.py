"""The exact grid belief against brute force: Bayes, moments, information, batching, and what must never break it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import poisson

from baselines.belief.grid import CENTRE_DISTANCE, GridBelief
from baselines.belief.grid_information import discount, expected_distance, expected_log_search_time, poisson_tables
from baselines.belief.likelihood import hit_model
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import PoissonCounter

AREA = np.array([14.0, 10.0, 6.0])
SOURCE = np.array([9.1, 6.2, 3.3])
SENSOR = PoissonCounter(false_positive_rate=0.02, miss_probability=0.1)
WINDS = [(0.0, -1.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 0.0)]


def belief_in(wind: tuple[float, float, float], n_beliefs: int = 1) -> GridBelief:
    belief = GridBelief(AREA, n_beliefs=n_beliefs)
    belief.use_model(hit_model(HitRatePlume(), SENSOR, np.array(wind)))
    return belief


def cells(belief: GridBelief) -> FloatArray:
    """(cells, 3) m, in the belief's order."""
    return np.array([belief.centre(c) for c in range(belief.n_cells)])


def rates(belief: GridBelief, wind: tuple[float, float, float], u: FloatArray) -> FloatArray:
    """Eq 1 written out with numpy, with the sensor's misses and false positives."""
    plume = HitRatePlume()
    speed = math.hypot(wind[0], wind[1])
    length = math.sqrt(plume.diffusivity * plume.lifetime / (1 + speed**2 * plume.lifetime / (4 * plume.diffusivity)))
    offset = u - cells(belief)
    distance = np.maximum(np.linalg.norm(offset, axis=1), max(0.5, CENTRE_DISTANCE * float(belief.size.mean())))
    rate = 2.5 / distance * np.exp(offset @ np.array(wind) / (2 * plume.diffusivity) - distance / length)
    return 0.9 * rate + 0.02


def some_readings(n: int, seed: int = 3) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Positions (1, n, 3), hits (1, n) and times (1, n) of readings anywhere, zeros among them."""
    generator = np.random.default_rng(seed)
    positions = generator.uniform(0.0, AREA, (1, n, 3))
    return positions, generator.poisson(0.7, (1, n)).astype(float), generator.integers(1, 5, (1, n)).astype(float)


@pytest.mark.parametrize("wind", WINDS)
def test_posterior_is_bayes_rule(wind: tuple[float, float, float]) -> None:
    belief = belief_in(wind)
    positions, hits, times = some_readings(12)
    expected = np.ones(belief.n_cells)
    for u, d, t in zip(positions[0], hits[0], times[0], strict=True):
        expected *= poisson.pmf(d, rates(belief, wind, u) * t)
        expected /= expected.sum()
    belief.update(positions[:, :5], hits[:, :5], times[:, :5])
    belief.update(positions[:, 5:], hits[:, 5:], times[:, 5:])
    np.testing.assert_allclose(belief.probability[0], expected, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(np.exp(belief.log_posterior[0]), expected, rtol=1e-9, atol=1e-15)
    assert belief.probability.sum() == pytest.approx(1.0, abs=1e-12)


def test_moments_entropy_mode_and_marginals() -> None:
    belief = belief_in(WINDS[1])
    belief.update(*some_readings(4))
    p, centres = belief.probability[0], cells(belief)
    mean, covariance = belief.moments()
    np.testing.assert_allclose(mean[0], p @ centres, rtol=1e-12)
    within = np.diag(belief.size**2 / 12.0)
    np.testing.assert_allclose(covariance[0], np.cov(centres.T, aweights=p, ddof=0) + within, atol=1e-9)
    assert belief.entropy()[0] == pytest.approx(-np.sum(p * np.log(p)), rel=1e-12)
    np.testing.assert_array_equal(belief.mode(), centres[np.argmax(p)])
    for layers, axis in zip(belief.marginals(), range(3), strict=True):
        values = np.unique(centres[:, axis])
        np.testing.assert_allclose(layers[0], [p[centres[:, axis] == value].sum() for value in values], atol=1e-14)


def test_a_row_of_a_batch_is_a_batch_of_one() -> None:
    batch = belief_in(WINDS[0], n_beliefs=3)
    batch.use_model(hit_model(HitRatePlume(), SENSOR, np.array(WINDS[2])), rows=1)
    positions, hits, times = some_readings(15)
    readings = positions.reshape(3, 5, 3), hits.reshape(3, 5), times.reshape(3, 5)
    batch.update(*readings)
    for row, wind in ((0, WINDS[0]), (1, WINDS[2]), (2, WINDS[0])):
        single = belief_in(wind)
        single.update(*(array[row : row + 1] for array in readings))
        np.testing.assert_array_equal(batch.log_posterior[row], single.log_posterior[0])
        np.testing.assert_array_equal(batch.probability[row], single.probability[0])
    before = batch.probability.copy()
    batch.reset([1])
    np.testing.assert_array_equal(batch.probability[[0, 2]], before[[0, 2]])
    assert np.ptp(batch.probability[1]) == 0.0


def naive_information(belief: GridBelief, wind: tuple[float, float, float], u: FloatArray, time: float) -> float:
    """H(w) - E[H'] by going through every outcome and every cell."""
    p = belief.probability[0]
    mean = rates(belief, wind, u) * time
    after = 0.0
    for d in range(80):
        joint = p * poisson.pmf(d, mean)
        total = joint.sum()
        if total > 1e-300:
            posterior = joint[joint > 0] / total
            after -= total * np.sum(posterior * np.log(posterior))
    return float(-np.sum(p[p > 0] * np.log(p[p > 0])) - after)


@pytest.mark.parametrize("wind", WINDS)
@pytest.mark.parametrize("n_readings", [0, 3, 25])
def test_information_is_the_expected_drop_of_entropy(wind: tuple[float, float, float], n_readings: int) -> None:
    belief = belief_in(wind)
    if n_readings:
        belief.update(*some_readings(n_readings))
    candidates = np.random.default_rng(5).uniform(0.0, AREA, (6, 3))
    found = belief.information(candidates, (1.0, 4.0))
    for u, row in zip(candidates, found, strict=True):
        for time, value in zip((1.0, 4.0), row, strict=True):
            # bins blur log lambda by a variance of up to width^2 / 4: measured errors stay below 0.3 %
            assert value == pytest.approx(naive_information(belief, wind, u, time), rel=5e-3, abs=3e-4)
    assert (found >= 0.0).all()


def test_merged_and_pruned_points_keep_the_information() -> None:
    belief = GridBelief(np.array([40.0, 30.0, 16.0]))
    belief.use_model(hit_model(HitRatePlume(), SENSOR, np.array(WINDS[0])))
    belief.update(np.array([[[20.0, 5.0, 8.0], [24.0, 9.0, 8.0]]]), np.array([[2.0, 0.0]]), np.array([[2.0, 4.0]]))
    candidates = np.random.default_rng(1).uniform(0.0, (40.0, 30.0, 16.0), (30, 3))
    exact = belief.information(candidates, (2.0,))[:, 0]
    points = belief.compressed(heavy=1 / 400, negligible=1e-4)
    assert points.shape[1] < belief.n_cells / 2
    assert points[0].sum() == pytest.approx(1.0)
    merged = belief.information(candidates, (2.0,), points)[:, 0]
    assert np.abs(merged - exact).max() < 0.05 * exact.max()
    delta, cells_kept = 0.05, belief.n_cells
    pruned = belief.compressed(negligible=delta)
    bound = delta * math.log(cells_kept) - delta * math.log(delta) - (1 - delta) * math.log(1 - delta)
    rest = belief.information(candidates, (2.0,), pruned)[:, 0]
    assert ((exact - (1 - delta) * rest) <= bound + 1e-9).all()


def test_expected_log_search_time_against_every_outcome() -> None:
    wind = WINDS[0]
    belief = belief_in(wind)
    belief.update(*some_readings(3))
    candidates = np.array([[4.0, 3.0, 2.0], [9.0, 2.0, 3.0], [13.0, 9.0, 5.0]])
    out = np.empty(3)
    tables = poisson_tables((1.0,))
    points = belief.compressed()
    expected_log_search_time(points, candidates, belief.models[0], tables.probability, tables.n_outcomes, 2.0, out)
    p = belief.probability[0]
    for u, value in zip(candidates, out, strict=True):
        mean, total = rates(belief, wind, u), 0.0
        distance = np.linalg.norm(cells(belief) - u, axis=1)
        for d in range(60):
            joint = p * poisson.pmf(d, mean)
            if joint.sum() < 1e-12:
                continue
            posterior = joint / joint.sum()
            bits = -np.sum(posterior * np.log2(np.maximum(posterior, 1e-300)))
            total += joint.sum() * math.log2(posterior @ distance / 2.0 + 2.0 ** (bits - 1.0) - 0.5)
        assert value == pytest.approx(total, rel=2e-3)


def test_discount_and_expected_distance() -> None:
    belief = belief_in(WINDS[0])
    places = np.array([[5.0, 3.0, 3.0], [9.0, 1.0, 4.0]])
    points = belief.compressed()
    discount(points, places, 3.0, belief.models[0])
    silent = belief_in(WINDS[0])
    silent.update(places[None], np.zeros((1, 2)), np.full((1, 2), 3.0))
    order = np.lexsort((points[1], points[2], points[3]))
    np.testing.assert_allclose(points[0, order], silent.probability[0], rtol=1e-9)
    out = np.empty(2)
    expected_distance(points, places, out)
    expected = [silent.probability[0] @ np.linalg.norm(cells(silent) - u, axis=1) for u in places]
    np.testing.assert_allclose(out, expected, rtol=1e-9)


def test_nothing_sampled_says_nothing() -> None:
    belief = belief_in(WINDS[0])
    belief.update(np.full((1, 2, 3), 3.0), np.array([[5.0, 0.0]]), np.array([[0.0, 0.0]]))
    assert np.ptp(belief.probability) == 0.0


def test_a_belief_survives_contradictions() -> None:
    """Many hits where no source could give any: the posterior stays a distribution, never NaN."""
    belief = GridBelief(AREA)
    belief.use_model(hit_model(HitRatePlume(), PoissonCounter(), np.array([0.0, -30.0, 0.0])))
    for _ in range(50):
        belief.update(np.array([[[7.0, 10.0, 3.0]]]), np.array([[400.0]]), np.array([[1.0]]))
        belief.update(np.array([[[7.0, 0.0, 3.0]]]), np.array([[0.0]]), np.array([[500.0]]))
    assert np.isfinite(belief.log_posterior).all()
    assert belief.probability.sum() == pytest.approx(1.0)
    belief.log_posterior[:] = -np.inf
    belief.update(np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros((1, 1)))
    assert np.ptp(belief.probability) == 0.0
    assert belief.probability.sum() == pytest.approx(1.0)


def test_one_cell() -> None:
    belief = GridBelief(np.array([1.0, 1.0, 1.0]))
    belief.use_model(hit_model(HitRatePlume(), SENSOR, np.array(WINDS[0])))
    belief.update(np.full((1, 1, 3), 0.5), np.array([[3.0]]), np.array([[1.0]]))
    assert belief.probability[0, 0] == pytest.approx(1.0)
    assert belief.information(np.full((1, 3), 0.2), (1.0,))[0, 0] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("wind", WINDS)
def test_a_source_beside_the_sensor_is_not_killed(wind: tuple[float, float, float]) -> None:
    """Sources anywhere in their cell, samples all around, hits drawn from the true point: errors match the spread."""
    generator = np.random.default_rng(0)
    plume, squares = HitRatePlume(), []
    for _ in range(40):
        source = generator.uniform(2.0, AREA - 2.0)
        belief = GridBelief(AREA)
        belief.use_model(hit_model(plume, PoissonCounter(), np.array(wind)))
        positions = np.clip(source + generator.normal(0.0, 1.5, (12, 3)), 0.0, AREA)
        rate = plume.field(positions, source[None], np.ones(1), np.array(wind))
        belief.update(positions[None], generator.poisson(rate * 2.0)[None].astype(float), np.full((1, 12), 2.0))
        mean, covariance = belief.moments()
        assert np.linalg.norm(mean[0] - source) < 5.0  # a right declaration
        squares.append(np.sum((mean[0] - source) ** 2) / np.trace(covariance[0]))
    assert np.mean(squares) < 2.5  # 1 if calibrated; cells of 2 m beside a source are coarse
