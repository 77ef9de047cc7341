"""The presets of the chemotaxis and GaSLAM papers: the papers' numbers, in the arena's coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from osl_env import load_scenario

PUFFS = ("puff-source1", "puff-source2", "puff-source3")
TUNNELS = ("tunnel-a", "tunnel-b", "tunnel-c", "tunnel-d")


@pytest.mark.parametrize(("name", "height"), list(zip(PUFFS, (2.0, 6.0, 10.0), strict=True)))
def test_the_puff_presets_are_the_papers_moved(name: str, height: float) -> None:
    """Subtracting the shift gives the paper's bounds, sources, starts and ground."""
    scenario: Any = load_scenario(name)
    shift = np.array([10.0, 15.0, -1.0])
    assert np.array_equal(scenario.arena.size, np.array([20.0, 15.0, 11.0]) + shift)
    assert np.array_equal(np.zeros(3) - shift, [-10.0, -15.0, 1.0])
    assert np.array_equal(scenario.sources.positions - shift, [[0.0, 0.0, height]])
    initial = [[15, -12, 4], [18, 12, 10], [16, 0, 8], [17, -8, 6], [15, 10, 9]]
    assert np.array_equal(scenario.team.starts - shift, initial)
    assert scenario.plume.ground == shift[2]
    assert (scenario.ending.success, scenario.ending.success_radius, scenario.ending.time_limit) == ("reach", 2, 600)
    assert (scenario.gas_sensor.threshold, scenario.wind.velocity) == (0.05, (2.0, 0.0, 0.0))
    assert scenario.ending.max_decisions * scenario.vehicle.decision_period >= scenario.ending.time_limit
    assert load_scenario(name, **{"vehicle.decision_period": 0.05}).decision_time == scenario.plume.tick


@pytest.mark.parametrize(
    ("name", "speed", "rate"), list(zip(TUNNELS, (0.2, 0.2, 0.7, 0.7), (20, 40, 20, 40), strict=True))
)
def test_the_tunnel_presets_are_the_papers(name: str, speed: float, rate: float) -> None:
    scenario: Any = load_scenario(name)
    assert scenario.wind.velocity == (speed, 0.0, 0.0)
    assert scenario.plume.filament_rate == rate
    assert (scenario.vehicle.speed, scenario.gas_sensor.period, scenario.ending.time_limit) == (0.5, 0.1, 270.0)
    centre = 1.0 / (np.sqrt(8 * np.pi**3) * 0.1**3)  # of the plugin's filament with w = 0.1 m
    assert scenario.plume.centre_concentration == pytest.approx(centre, rel=1e-3)
    assert scenario.plume.sigma == pytest.approx(0.1 / np.sqrt(2), rel=1e-3)
    assert scenario.plume.diffusion == pytest.approx(0.3 * np.sqrt(1 / 30), rel=1e-3)
    # the plume has time to cross the search volume before the flight, and no filament ends inside it
    crossing = scenario.arena.size[0] / speed
    assert crossing < scenario.plume.development
    assert crossing + 3 * scenario.plume.diffusion * np.sqrt(crossing) / speed < scenario.plume.max_age


@pytest.mark.parametrize("name", PUFFS + TUNNELS)
def test_random_presets_differ_in_what_they_draw_alone(name: str) -> None:
    fixed, drawn = load_scenario(name), load_scenario(f"{name}-random")
    low, high = np.array(drawn.sources.region)
    position = np.array(fixed.sources.positions[0])
    assert np.all(low <= position)
    assert np.all(position <= high)
    same = {"name", "description", "sources", "wind"}
    assert fixed.model_dump(exclude=same) == drawn.model_dump(exclude=same)


@pytest.mark.parametrize("name", TUNNELS)
def test_real_tunnels_differ_in_the_wind_s_fluctuations_and_the_sensor_s_lag_alone(name: str) -> None:
    ideal: Any = load_scenario(name)
    real: Any = load_scenario(f"{name}-real")
    other = {"name", "description", "wind", "gas_sensor"}
    assert ideal.model_dump(exclude=other) == real.model_dump(exclude=other)
    assert (real.wind.velocity, real.wind.kind) == (ideal.wind.velocity, "meander")
    assert real.wind.speed_std / real.wind.speed == pytest.approx(0.2)
    assert real.wind.angle_time * real.wind.speed == pytest.approx(4.0, rel=0.01)  # the tunnel's width
    lag = {"rise_time": 1.0, "recovery_time": 1.0}
    assert ideal.gas_sensor.model_dump() | lag == real.gas_sensor.model_dump()
    assert ideal.gas_sensor.rise_time == ideal.gas_sensor.recovery_time == 0.0
    drawn = load_scenario(f"{name}-real-random")
    assert drawn.sources == load_scenario(f"{name}-random").sources
