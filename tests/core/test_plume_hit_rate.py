"""The rate-based plume against MUC-OSL eqs 1 and 2 written out, and the symmetries that the equations have."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import begun, small

from osl_env.air import uniform_air
from osl_env.geometry import open_air
from osl_env.parameters import FloatArray
from osl_env.plumes.base import Scene
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.state import MOTION

PLUME = HitRatePlume(source_strength=2.5, diffusivity=1.3, lifetime=80.0)
SOURCE = np.array([[40.0, 30.0, 12.0]])
ONE = np.ones(1)


def points(n: int = 500, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform((0, 0, 0), (80, 60, 30), (n, 3))


def written_out(places: FloatArray, source: FloatArray, wind: Any, plume: HitRatePlume = PLUME) -> FloatArray:
    """Eqs 1 and 2, term by term, with |u - s| clamped."""
    offset = places - source
    distance = np.maximum(np.linalg.norm(offset, axis=-1), plume.clamp_distance)
    speed = float(np.hypot(wind[0], wind[1]))
    decay = np.sqrt(plume.diffusivity * plume.lifetime / (1 + speed**2 * plume.lifetime / (4 * plume.diffusivity)))
    drift = (offset[..., 0] * wind[0] + offset[..., 1] * wind[1]) / (2 * plume.diffusivity)
    rate: FloatArray = plume.source_strength / distance * np.exp(drift) * np.exp(-distance / decay)
    return rate


@pytest.mark.parametrize(
    "wind", [(0.0, -1.0, 0.0), (1.5, 0.7, 0.0), (-0.2, 0.1, 0.0), (0.0, 0.0, 0.0), (4.0, -3.0, 0.0)]
)
def test_field_is_equation_1(wind: tuple[float, float, float]) -> None:
    places = points()
    field = PLUME.field(places, SOURCE, ONE, np.array(wind))
    np.testing.assert_allclose(field, written_out(places, SOURCE[0], wind), rtol=1e-12, atol=1e-300)


def test_the_printed_case_of_wind_along_minus_y() -> None:
    """Eq 1 as printed: exp(-(y - y0) V / (2 D)), for wind along -y."""
    places = points()
    offset = places - SOURCE[0]
    distance = np.linalg.norm(offset, axis=-1)
    printed = 2.5 / distance * np.exp(-offset[:, 1] * 1.0 / 2.6) * np.exp(-distance * PLUME.inverse_lambda(1.0))
    np.testing.assert_allclose(PLUME.field(places, SOURCE, ONE, np.array([0.0, -1.0, 0.0])), printed, rtol=1e-12)


def test_the_air_carries_hits_downwind() -> None:
    upwind, downwind = SOURCE[0] - [10.0, 0, 0], SOURCE[0] + [10.0, 0, 0]
    up, down = PLUME.field(np.array([upwind, downwind]), SOURCE, ONE, np.array([1.0, 0.0, 0.0]))
    assert down > 100 * up


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, 2.0, np.pi, 5.1])
def test_turning_the_world_turns_the_field(angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    places, wind = points(), np.array([0.8, -0.5, 0.0])
    turned = PLUME.field(places @ turn.T, SOURCE @ turn.T, ONE, turn @ wind)
    np.testing.assert_allclose(turned, PLUME.field(places, SOURCE, ONE, wind), rtol=1e-10)


def test_moving_the_world_moves_the_field() -> None:
    places, wind, shift = points(), np.array([0.8, -0.5, 0.0]), np.array([3.0, -7.0, 2.0])
    np.testing.assert_allclose(
        PLUME.field(places + shift, SOURCE + shift, ONE, wind), PLUME.field(places, SOURCE, ONE, wind), rtol=1e-10
    )


def test_without_wind_the_field_is_isotropic() -> None:
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rates = PLUME.field(SOURCE[0] + 7.0 * directions, SOURCE, ONE, np.zeros(3))
    np.testing.assert_allclose(rates, 2.5 / 7.0 * np.exp(-7.0 / np.sqrt(1.3 * 80.0)), rtol=1e-12)


def test_zero_wind_is_the_limit_of_light_winds() -> None:
    calm = PLUME.field(points(), SOURCE, ONE, np.zeros(3))
    for speed in (1e-4, 1e-6, 1e-9):
        light = PLUME.field(points(), SOURCE, ONE, np.array([speed, -speed, 0.0]))
        # first order in V: |u - s| V / D at most, and |u - s| <= 70 m
        np.testing.assert_allclose(light, calm, rtol=200 * speed + 1e-12)


def test_sources_add() -> None:
    sources, wind = np.array([[40.0, 30, 12], [10, 50, 3], [70, 5, 25]]), np.array([0.5, 0.5, 0.0])
    strengths = np.array([1.0, 0.4, 3.0])
    total = sum(PLUME.field(points(), sources[k : k + 1], strengths[k : k + 1], wind) for k in range(3))
    np.testing.assert_allclose(PLUME.field(points(), sources, strengths, wind), total, rtol=1e-12)


def test_the_field_is_linear_in_the_strength() -> None:
    wind = np.array([0.0, -1.0, 0.0])
    once = PLUME.field(points(), SOURCE, ONE, wind)
    np.testing.assert_allclose(PLUME.field(points(), SOURCE, 3.0 * ONE, wind), 3 * once, rtol=1e-12)
    stronger = HitRatePlume(source_strength=7.5, diffusivity=1.3, lifetime=80.0)
    np.testing.assert_allclose(stronger.field(points(), SOURCE, ONE, wind), 3 * once, rtol=1e-12)


def test_near_the_source_the_distance_is_clamped() -> None:
    on_it = PLUME.field(SOURCE, SOURCE, ONE, np.array([1.0, 0.0, 0.0]))[0]
    assert on_it == pytest.approx(2.5 / 0.5 * np.exp(-0.5 * PLUME.inverse_lambda(1.0)), rel=1e-12)
    edge = PLUME.field(np.add(SOURCE, [0, 0.5, 0]), SOURCE, ONE, np.array([1.0, 0.0, 0.0]))[0]
    assert edge == pytest.approx(on_it, rel=1e-12)


def test_the_field_solves_advection_diffusion_decay_away_from_the_source() -> None:
    """Eq 1 is the steady solution of D lap R - V . grad R - R / tau = 0: checked with central differences."""
    wind, h = np.array([0.6, -0.4, 0.0]), 1e-3
    places = SOURCE[0] + np.array([[3.0, 1, 2], [-2, 4, -1], [5, -5, 3], [0.5, -3, 0]])

    def rate(offset: Any) -> FloatArray:
        return PLUME.field(places + np.array(offset), SOURCE, ONE, wind)

    steps = h * np.eye(3)
    laplacian = sum(rate(step) - 2 * rate((0, 0, 0)) + rate(-step) for step in steps) / h**2
    gradient = np.stack([(rate(step) - rate(-step)) / (2 * h) for step in steps], axis=-1)
    residual = 1.3 * laplacian - gradient @ wind - rate((0, 0, 0)) / 80.0
    np.testing.assert_allclose(residual / rate((0, 0, 0)), 0.0, atol=1e-4)


def test_vertical_wind_is_ignored() -> None:
    level = PLUME.field(points(), SOURCE, ONE, np.array([0.4, 0.2, 0.0]))
    assert np.array_equal(PLUME.field(points(), SOURCE, ONE, np.array([0.4, 0.2, 5.0])), level)


def test_field_keeps_the_shape_of_its_places() -> None:
    grid = points(24).reshape(2, 3, 4, 3)
    field = PLUME.field(grid, SOURCE, ONE, np.array([0.0, -1.0, 0.0]))
    assert field.shape == (2, 3, 4)
    assert np.array_equal(field.reshape(-1), PLUME.field(grid.reshape(-1, 3), SOURCE, ONE, np.array([0.0, -1.0, 0.0])))


@pytest.mark.parametrize(
    ("n_envs", "n_uavs", "n_sources"), [(1, 1, 1), (3, 2, 3), (100, 3, 2), (300, 1, 1), (2, 400, 2)]
)
def test_batched_reading_is_the_field(n_envs: int, n_uavs: int, n_sources: int) -> None:
    """Also over the boundaries of the kernel's blocks, with a wind and sources of each world's own."""
    rng = np.random.default_rng(5)
    motion, air = np.zeros((n_envs, n_uavs), MOTION), uniform_air(n_envs)
    places, winds = motion["position"], air.mean
    places[:] = rng.uniform(0, 30, (n_envs, n_uavs, 3))
    winds[:, :2] = rng.normal(size=(n_envs, 2))
    sources = rng.uniform(0, 30, (n_envs, n_sources, 3))
    strengths = rng.uniform(0.5, 2, (n_envs, n_sources))
    out = np.full((n_envs, n_uavs), np.nan)
    scene = Scene(sources, strengths, air, open_air(), np.full(3, 30.0), places)
    PLUME.read(None, scene, places, np.ones(n_envs, np.bool_), out)
    expected = [PLUME.field(places[e], sources[e], strengths[e], winds[e]) for e in range(n_envs)]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def test_worlds_smell_all_their_sources_with_their_strengths() -> None:
    sources = [(12.0, 13.0, 5.0), (4.0, 4.0, 1.0)]
    world = begun(small(**{"sources.positions": sources, "sources.strengths": [1.0, 2.5]}), [1, 2])
    plume, wind = world.scenario.plume, np.array([0.0, -1.0, 0.0])
    expected = plume.field(world.motion["position"][0], np.array(sources), np.array([1.0, 2.5]), wind)
    np.testing.assert_allclose(world.rates, [expected, expected], rtol=1e-12)
