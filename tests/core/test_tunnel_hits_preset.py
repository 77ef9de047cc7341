"""The preset tunnel-hits: the rate plume that policies are told of, and the unit of its counts, fit the plume."""

from __future__ import annotations

import numpy as np

from osl_env import World, load_scenario
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import MoxSensor

WORLDS, MOMENTS = 24, 12
APART = 2.5  # s between two moments: filaments have then moved on by 0.5 m, seven of their sigmas
STATIONS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])  # m downwind


def counts_on_the_axis() -> FloatArray:
    """(MOMENTS, WORLDS, stations) 1/s."""
    scenario = load_scenario("tunnel-hits-random")
    world = World(scenario, WORLDS)
    world.reset(np.arange(WORLDS))
    unit = scenario.gas_sensor.response()["count_unit"][0]
    out = np.empty((MOMENTS, WORLDS, len(STATIONS)))
    for k in range(MOMENTS):
        for e in range(WORLDS):
            points = world.source_position[e, 0] + STATIONS[:, None] * np.array([1.0, 0.0, 0.0])
            out[k, e] = world.concentration(e, points) / unit
        world.run_air(APART)
    return out


def test_counts_are_as_told_and_vary_as_poissons() -> None:
    scenario = load_scenario("tunnel-hits")
    told, wind = scenario.told_plume, scenario.wind.draw(np.arange(1))[0]
    assert isinstance(told, HitRatePlume)
    counts = counts_on_the_axis()
    mean, variance = counts.mean(axis=(0, 1)), counts.var(axis=(0, 1))
    rates = told.field(STATIONS[:, None] * np.array([1.0, 0.0, 0.0]), np.zeros((1, 3)), np.ones(1), wind)
    # 288 nearly independent readings whose deviation is 0.3 to 0.8 of the mean: the standard error is 2 to 5 % of it;
    # the told plume itself is 20 % too high at 1 m, 4 % too low at 4 m
    np.testing.assert_allclose(rates / mean, 1.0, atol=0.35)
    # a sample's count varies as Poisson's: count_unit is 1.0 to 1.15 of what does so exactly, its standard error 15 %
    dispersion = scenario.vehicle.hover_time * variance / mean
    assert 0.7 < dispersion.mean() < 1.5
    assert np.all((dispersion > 0.4) & (dispersion < 2.2))


def test_no_leg_saturates_the_counter() -> None:
    scenario = load_scenario("tunnel-hits")
    sensor, vehicle = scenario.gas_sensor, scenario.vehicle
    assert isinstance(sensor, MoxSensor)
    assert sensor.count_unit is not None
    assert sensor.max_count == vehicle.max_samples * vehicle.hover_time * sensor.full_scale / sensor.count_unit


def test_the_random_preset_draws_the_source_across_the_wind_only() -> None:
    region = load_scenario("tunnel-hits-random").sources.region
    assert region is not None
    low, high = region
    assert low[0] == high[0] == load_scenario("tunnel-hits").sources.positions[0][0]
    assert load_scenario("tunnel-a-random").sources == load_scenario("tunnel-hits-random").sources
