"""The likelihood of counts that saturate, against scipy; which sensors policies that count can use."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import HitModel, add_log_likelihood, hit_model, hits_per_second, log_saturated
from baselines.features.belief_kernels import MEMORY, _weigh
from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import IdealSensor, MoxSensor, PidSensor, PoissonCounter

PLUME = HitRatePlume()
WIND = np.array([0.3, -0.5, 0.0])
AREA = np.array([20.0, 16.0, 8.0])


def model(max_count: int | None) -> HitModel:
    return hit_model(PLUME, IdealSensor(count_unit=1.0, max_count=max_count), WIND)


def places(n: int = 500) -> FloatArray:
    """(3, n) m."""
    return np.ascontiguousarray(np.random.default_rng(0).uniform(0, AREA, (n, 3)).T)


def weights(reading: FloatArray, hits: HitModel) -> FloatArray:
    x, y, z = places()
    log_weight = np.zeros(x.size)
    add_log_likelihood(x, y, z, log_weight, reading, 1.0, hits)
    return log_weight


def rates(position: FloatArray, sources: FloatArray, hits: HitModel) -> FloatArray:
    """(n,) mean counts a second at `position` (3,) for each of `sources` (n, 3), m."""
    return np.array([hits_per_second(x, y, z, hits) for x, y, z in position - sources])


def means(reading: FloatArray, hits: HitModel) -> FloatArray:
    """(n,) mean counts of `reading` for a source at each of the places."""
    return float(reading[4]) * rates(reading[:3], places().T, hits)


@pytest.mark.parametrize("count", [1, 2, 7, 60, 900])
def test_a_saturated_reading_is_the_tail_of_the_poisson_law(count: int) -> None:
    mean = np.geomspace(1e-6, 4000.0, 150)
    ours = np.array([log_saturated(float(count), m) for m in mean]) - math.lgamma(count + 1.0)
    reference = stats.poisson.logsf(count - 1, mean)
    held = np.isfinite(reference)  # scipy's tail ends where its probability does
    np.testing.assert_allclose(ours[held], reference[held], rtol=1e-9, atol=1e-12)
    assert np.all(np.diff(ours) >= 0.0)
    assert np.all(np.isfinite(ours))


@pytest.mark.parametrize("hits", [0.0, 1.0, 3.0, 4.0])
def test_the_likelihood_follows_the_saturation(hits: float) -> None:
    reading = np.array([9.0, 8.0, 4.0, hits, 1.5, 0.0])
    whole, saturating = model(None), model(4)
    mean = means(reading, whole)
    constant = math.lgamma(hits + 1.0)
    exact = stats.poisson.logpmf(hits, mean) if hits < 4 else stats.poisson.logsf(3, mean)
    np.testing.assert_allclose(weights(reading, saturating), exact + constant, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(weights(reading, whole), stats.poisson.logpmf(hits, mean) + constant, atol=1e-9)
    if hits < 4:
        assert np.array_equal(weights(reading, saturating), weights(reading, whole))


def test_the_probabilities_of_all_readings_sum_to_one() -> None:
    for place in (np.array([9.0, 8.0, 4.0]), np.array([1.0, 1.0, 1.0])):
        rows = [np.array([*place, d, 1.0, 0.0]) for d in range(6)]
        total = sum(np.exp(weights(row, model(5)) - math.lgamma(row[3] + 1.0)) for row in rows)
        np.testing.assert_allclose(total, 1.0, rtol=1e-12)


def test_grid_and_belief_features_follow_it_too() -> None:
    position, seconds, hits = np.array([9.0, 8.0, 4.0]), 1.0, 3.0
    belief = GridBelief(AREA, cell=2.0)
    belief.use_model(model(3))
    belief.update(position[None, None], np.array([[hits]]), np.array([[seconds]]))
    centres = np.array([belief.centre(cell) for cell in range(belief.n_cells)])
    _, _, _, strength, clamp, background, _ = belief.models[0]
    rule = model(3)._replace(strength=strength, clamp_distance=clamp, background=background)
    mean = seconds * rates(position, centres, rule)
    expected = stats.poisson.sf(2, mean)
    np.testing.assert_allclose(belief.probability[0], expected / expected.sum(), rtol=1e-9)

    reading = np.array([*position, hits, seconds, 0.0])
    cloud = np.zeros((5, places().shape[1]), np.float32)
    cloud[:3] = places()
    memory = np.zeros(MEMORY)
    memory[1:3] = WIND[:2]
    advertised = [rule.strength, PLUME.diffusivity, PLUME.lifetime, PLUME.clamp_distance, 0.0, 1.0, 3.0]
    _weigh(cloud, reading, memory, np.array(advertised))
    single = cloud[3] - cloud[3].max()
    double = weights(reading, model(3))
    np.testing.assert_allclose(single, double - double.max(), rtol=1e-4, atol=1e-4)


def test_sensors_that_count_are_fit_for_policies_that_count() -> None:
    counter = hit_model(PLUME, PoissonCounter(miss_probability=0.25, false_positive_rate=0.1), WIND)
    assert (counter.detection_probability, counter.background, counter.max_count) == (0.75, 0.1, math.inf)
    sensor = hit_model(PLUME, MoxSensor(count_unit=2.0, max_count=9), WIND)
    assert (sensor.detection_probability, sensor.background, sensor.max_count) == (1.0, 0.0, 9.0)
    assert model(None) == counter._replace(detection_probability=1.0, background=0.0)
    with pytest.raises(InputError, match=r"gas_sensor.kind = 'pid'.*count_unit"):
        hit_model(PLUME, PidSensor(), WIND)
