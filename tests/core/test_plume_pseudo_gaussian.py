"""The steady pseudo-Gaussian plume against GaSLAM eq 2 written out, its flux, and its symmetries."""

from __future__ import annotations

import numpy as np
import pytest

from osl_env.air import uniform_air
from osl_env.geometry import open_air
from osl_env.parameters import FloatArray
from osl_env.plumes.base import Scene
from osl_env.plumes.pseudo_gaussian import PseudoGaussianPlume

PLUME = PseudoGaussianPlume(release_rate=3.0, growth_y=0.12, growth_z=0.07, width_y=0.2, width_z=0.15)
SOURCE = np.array([[2.0, 3.0, 1.0]])
ONE = np.ones(1)


def points(n: int = 400, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform((-4, -3, -1), (8, 9, 3), (n, 3))


def test_the_printed_case_of_wind_along_x() -> None:
    places = points()
    x, y, z = (places - SOURCE).T
    sy, sz = 0.12 * x + 0.2, 0.07 * x + 0.15
    printed = 3.0 / (2 * np.pi * 0.7 * sy * sz) * np.exp(-(y**2) / (2 * sy**2) - z**2 / (2 * sz**2))
    field = PLUME.field(places, SOURCE, ONE, np.array([0.7, 0.0, 0.0]))
    np.testing.assert_allclose(field, np.where(x >= 0, printed, 0.0), rtol=1e-11, atol=1e-300)
    assert np.all(field[x < 0] == 0.0)


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, 2.0, np.pi, 5.1])
def test_turning_the_world_turns_the_field(angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    wind = np.array([0.8, -0.5, 0.0])
    turned = PLUME.field(points() @ turn.T, SOURCE @ turn.T, ONE, turn @ wind)
    np.testing.assert_allclose(turned, PLUME.field(points(), SOURCE, ONE, wind), rtol=1e-9, atol=1e-200)


@pytest.mark.parametrize("distance", [0.0, 0.5, 3.0, 20.0])
@pytest.mark.parametrize("speed", [0.05, 0.2, 2.0])
def test_the_release_rate_passes_through_every_plane_across_the_wind(distance: float, speed: float) -> None:
    width, height = 0.12 * distance + 0.2, 0.07 * distance + 0.15
    y, z = np.meshgrid(np.linspace(-7, 7, 141) * width, np.linspace(-7, 7, 141) * height)
    places = SOURCE + np.stack([np.full(y.shape, distance), y, z], axis=-1)
    flux = speed * PLUME.field(places, SOURCE, ONE, np.array([speed, 0, 0])).sum() * 0.01 * width * height
    assert flux == pytest.approx(3.0, rel=1e-9)


@pytest.mark.parametrize("radius", [0.5, 3.0, 20.0])
def test_at_rest_the_release_rate_passes_through_every_cylinder(radius: float) -> None:
    height = 0.07 * radius + 0.15
    z = np.linspace(-7, 7, 1401) * height
    angle = np.random.default_rng(1).uniform(0, 2 * np.pi, z.size)
    places = SOURCE + np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    line = PLUME.field(places, SOURCE, ONE, np.zeros(3)).sum() * 0.01 * height
    assert 2 * np.pi * radius * PLUME.minimum_speed * line == pytest.approx(3.0, rel=1e-9)


def test_slow_wind_keeps_its_direction_and_air_at_rest_is_finite() -> None:
    slow = PLUME.field(points(), SOURCE, ONE, np.array([1e-7, -2e-7, 0]))
    least = PLUME.field(points(), SOURCE, ONE, 0.05 / np.hypot(1, 2) * np.array([1.0, -2.0, 0]))
    np.testing.assert_allclose(slow, least, rtol=1e-9, atol=1e-200)
    on_it = PLUME.field(SOURCE, SOURCE, ONE, np.zeros(3))
    np.testing.assert_allclose(on_it, 3.0 / (2 * np.pi * 0.05 * 0.2 * 0.15), rtol=1e-12)
    assert np.isfinite(PLUME.field(points(), SOURCE, ONE, np.zeros(3))).all()


def test_sources_add_and_the_field_is_linear_in_the_rate() -> None:
    sources, strengths = np.array([[2.0, 3, 1], [0, 0, 0], [5, 1, 2]]), np.array([1.0, 0.4, 3.0])
    wind = np.array([0.5, 0.5, 0.0])
    total = sum(PLUME.field(points(), sources[k : k + 1], strengths[k : k + 1], wind) for k in range(3))
    np.testing.assert_allclose(PLUME.field(points(), sources, strengths, wind), total, rtol=1e-12)
    twice = PseudoGaussianPlume(**(PLUME.model_dump() | {"release_rate": 6.0}))
    np.testing.assert_allclose(twice.field(points(), sources, strengths, wind), 2 * total, rtol=1e-12)


def test_ppm_are_grams_by_the_ideal_gas_law() -> None:
    """1 mg/m^3 of methane (16.04 g/mol) at 25 C and 1 atm is 1.525 ppm."""
    methane = PseudoGaussianPlume(
        **(PLUME.model_dump() | {"gas_unit": "ppm", "molar_mass": 16.04, "temperature": 298.15})
    )
    wind = np.array([0.5, 0.0, 0.0])
    assert (methane.unit, PLUME.unit) == ("ppm", "g/m^3")
    np.testing.assert_allclose(
        methane.field(points(), SOURCE, ONE, wind), 1525.3 * PLUME.field(points(), SOURCE, ONE, wind), rtol=1e-4
    )


def test_the_batched_reading_is_the_field_row_by_row() -> None:
    rng = np.random.default_rng(5)
    air = uniform_air(20)
    air.mean[:, :2] = rng.normal(size=(20, 2))
    air.mean[3] = 0.0
    sources, strengths = rng.uniform(0, 5, (20, 2, 3)), rng.uniform(0.5, 2, (20, 2))
    positions = rng.uniform(0, 5, (20, 4, 3))
    scene = Scene(sources, strengths, air, open_air(), np.full(3, 5.0), positions)
    due = rng.random(20) < 0.7
    out = np.full((20, 4), -1.0)
    PLUME.read(None, scene, positions, due, out)
    for e in range(20):
        field = PLUME.field(positions[e], sources[e], strengths[e], air.mean[e])
        assert np.array_equal(out[e], field if due[e] else np.full(4, -1.0))
        assert np.array_equal(PLUME.at(None, scene, e, positions[e].reshape(2, 2, 3)), field.reshape(2, 2))
