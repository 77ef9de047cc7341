"""Winds that change: their moments, autocorrelation and scales, and that neither the tick nor the batch matters."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from osl_env.air import local_winds
from osl_env.arena import Arena
from osl_env.parameters import FloatArray
from osl_env.winds.base import Wind, WindState
from osl_env.winds.meander import MeanderingWind
from osl_env.winds.series import SeriesWind
from osl_env.winds.turbulence import TurbulentWind
from osl_env.winds.turbulence_kernels import NOISE_COLUMNS, noise_coefficients

ARENA = Arena(size=(100.0, 60.0, 30.0))
CHANGING = [MeanderingWind(vertical_std=0.1), TurbulentWind(), SeriesWind()]
SETTINGS: list[dict[str, Any]] = [{}, {"random_direction": True}]


def begun(wind: Wind, seeds: Any, start: float = 0.0) -> WindState:
    numbers = np.asarray(seeds, np.int64)
    state = wind.allocate(len(numbers), ARENA)
    wind.begin(state, np.arange(len(numbers)), numbers, start)
    return state


def go_on(wind: Wind, state: WindState, seconds: float, tick: float) -> WindState:
    n_envs = len(state.streams)
    for k in range(round(seconds / tick)):
        wind.advance(state, np.ones(n_envs, np.bool_), np.full(n_envs, (k + 1) * tick), tick)
    return state


def velocities(state: WindState, *place: float) -> FloatArray:
    """The air (n_envs, 3) of all worlds at `place`, m."""
    positions = np.tile(place or (50.0, 30.0, 5.0), (len(state.streams), 1, 1))
    out = np.empty_like(positions)
    local_winds(state.air, positions, out)
    return out[:, 0]


def correlation(a: FloatArray, b: FloatArray) -> float:
    return float(np.corrcoef(a, b)[0, 1])


@pytest.mark.parametrize("start", [0.0, -300.0])
@pytest.mark.parametrize("seconds", [0.0, 40.0])
def test_meander_has_its_moments_at_the_start_and_later(start: float, seconds: float) -> None:
    n = 20_000
    wind = MeanderingWind(velocity=(0.6, 0.8, 0.0), speed_std=0.3, angle_std=0.5, vertical_std=0.1)
    u = velocities(go_on(wind, begun(wind, np.arange(n), start), seconds, 2.0))
    along, across = u @ [0.6, 0.8, 0.0], u @ [-0.8, 0.6, 0.0]
    # standard deviations of the terms averaged are below 0.7; 5 standard errors
    assert abs(along.mean() - math.exp(-0.125)) < 5 * 0.7 / math.sqrt(n)
    assert abs(across.mean()) < 5 * 0.7 / math.sqrt(n)
    assert abs((along**2 + across**2).mean() - 1.09) < 5 * 0.7 / math.sqrt(n)
    assert abs(u[:, 2].std() - 0.1) < 5 * 0.1 / math.sqrt(2 * n)


@pytest.mark.parametrize("tick", [2.0, 1.0, 0.5])
def test_meander_forgets_with_its_correlation_times_whatever_the_tick(tick: float) -> None:
    n = 10_000
    wind = MeanderingWind(velocity=(1.0, 0.0, 0.0), angle_std=0.05, speed_time=10.0, angle_time=40.0)
    state = begun(wind, np.arange(n))
    before = velocities(state).copy()
    after = velocities(go_on(wind, state, 20.0, tick))
    speed = correlation(np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1))
    angle = correlation(np.arctan2(before[:, 1], before[:, 0]), np.arctan2(after[:, 1], after[:, 0]))
    assert abs(speed - math.exp(-2.0)) < 5 / math.sqrt(n)  # a correlation's standard error is at most 1 / sqrt(n)
    assert abs(angle - math.exp(-0.5)) < 5 / math.sqrt(n)


def test_meander_without_mean_wind_has_no_mean_and_no_preferred_direction() -> None:
    n = 10_000
    u = velocities(begun(MeanderingWind(velocity=(0.0, 0.0, 0.0), speed_std=0.5), np.arange(n)))
    assert np.all(np.abs(u.mean(axis=0)) < 5 * 0.5 / math.sqrt(2 * n))
    np.testing.assert_allclose(u[:, :2].std(axis=0), 0.5 / math.sqrt(2), rtol=5 / math.sqrt(n))


def test_meander_has_no_jumps_through_a_lull() -> None:
    wind = MeanderingWind(velocity=(0.1, 0.0, 0.0), speed_std=0.3)
    state, last = begun(wind, [1, 2, 3]), None
    for _ in range(2000):
        u = velocities(go_on(wind, state, 0.01, 0.01)).copy()
        # a change in 0.01 s has standard deviations 0.3 sqrt(2 / 20 / 100) = 0.0095 and 0.3 |u| sqrt(2 / 60 / 100) m/s
        assert last is None or np.abs(u - last).max() < 0.08
        last = u


@pytest.mark.parametrize("cls", [MeanderingWind, TurbulentWind])
@pytest.mark.parametrize("velocity", [(0.5, -1.0, 0.0), (0.0, 0.0, 0.0)])
def test_without_deviations_a_wind_is_steady_and_uniform(cls: type[Wind], velocity: Any) -> None:
    still = {"noise_std": 0.0} if cls is TurbulentWind else {"speed_std": 0.0, "angle_std": 0.0}
    wind = cls(velocity=velocity, **still)
    assert not wind.changes
    state = begun(wind, [1, 2])
    for place in ((0.0, 0.0, 0.0), (33.0, 7.0, 29.0), (100.0, 60.0, 30.0)):
        np.testing.assert_allclose(velocities(state, *place), [velocity] * 2, atol=1e-7)


@pytest.mark.parametrize("kind", [MeanderingWind, SeriesWind])
def test_a_random_direction_turns_the_same_wind(kind: type[Wind]) -> None:
    usual, turned = kind(), kind(random_direction=True)
    seeds = np.arange(5)
    a, b = begun(usual, seeds), begun(turned, seeds)
    mean, turned_mean = usual.draw(seeds), turned.draw(seeds)
    angle = np.arctan2(turned_mean[:, 1], turned_mean[:, 0]) - np.arctan2(mean[:, 1], mean[:, 0])
    u, v = velocities(go_on(usual, a, 30.0, 3.0)).T[:2]
    rotated = np.stack([u * np.cos(angle) - v * np.sin(angle), u * np.sin(angle) + v * np.cos(angle)], axis=1)
    np.testing.assert_allclose(velocities(go_on(turned, b, 30.0, 3.0))[:, :2], rotated, atol=1e-9)
    assert np.ptp(angle) > 0.1


def test_the_turbulent_wind_blows_about_a_mean_that_is_turned() -> None:
    wind = TurbulentWind(random_direction=True)
    seeds = np.arange(400)
    difference = velocities(begun(wind, seeds)) - wind.draw(seeds)
    assert np.all(np.abs(difference.mean(axis=0)) < 5 * 0.4 / 20)  # deviations are at most those of the corners
    assert difference[:, 0].std() > 0.1


def test_coloured_noise_is_the_same_in_two_half_steps() -> None:
    for omega, zeta in ((0.2, 0.1), (0.71, 0.071), (2.0, 1.0)):
        for step in (1e-3, 0.1, 5.0):
            whole, half = (noise_coefficients(h, 0.4, omega, zeta) for h in (step, step / 2))
            (move, spread), (half_move, half_spread) = matrices(whole), matrices(half)
            np.testing.assert_allclose(half_move @ half_move, move, atol=1e-12)
            np.testing.assert_allclose(half_move @ half_spread @ half_move.T + half_spread, spread, atol=1e-12)
            stationary = 0.16 * np.diag([1.0, omega**2])
            np.testing.assert_allclose(move @ stationary @ move.T + spread, stationary, atol=1e-12)


def matrices(coefficients: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """What the noise's state is multiplied by, and the covariance of what is added."""
    a, b, c, d, p, r, q = coefficients
    factor = np.array([[p, r], [q, 0.0]])
    return np.array([[a, b], [c, d]]), factor @ factor.T


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (50.0, 30.0, 0.0), (90.0, 20.0, 0.0)])
def test_turbulence_does_not_depend_on_the_tick(place: tuple[float, float, float]) -> None:
    n, wind = 800, TurbulentWind(noise_bandwidth=0.2)
    spreads, memories = [], []
    for tick in (2.0, 1.0):
        state = begun(wind, np.arange(n))
        before = velocities(state, *place)[:, 0].copy()
        after = velocities(go_on(wind, state, 6.0, tick), *place)[:, 0]
        spreads.append(after.std())
        memories.append(correlation(before, after))
    # the same seeds begin alike, so the differences are smaller than those of independent samples
    np.testing.assert_allclose(spreads[1], spreads[0], rtol=5 / math.sqrt(n))
    assert abs(memories[1] - memories[0]) < 5 / math.sqrt(n)


def test_turbulence_is_stationary_and_less_alike_farther_away() -> None:
    n, wind = 1500, TurbulentWind(velocity=(1.0, 0.0, 0.0), diffusivity=4.0)
    state = begun(wind, np.arange(n))
    fresh = velocities(state).std(axis=0)
    go_on(wind, state, 300.0, 3.0)
    np.testing.assert_allclose(velocities(state).std(axis=0)[:2], fresh[:2], rtol=5 / math.sqrt(n))
    here = velocities(state)[:, 1]
    alike = [correlation(here, velocities(state, 50.0 + away, 30.0, 0.0)[:, 1]) for away in (1.0, 10.0, 20.0, 40.0)]
    assert alike[0] > 0.98
    assert all(near > far for near, far in itertools.pairwise(alike))
    assert alike[0] - alike[-1] > 5 / math.sqrt(n)  # a correlation's standard error is at most 1 / sqrt(n)


def test_small_waves_decay_as_diffusion_says() -> None:
    wind = TurbulentWind(velocity=(0.0, 0.0, 0.0), noise_std=0.0, diffusivity=2.0, nodes=41)
    state = begun(wind, [0])
    nx, ny = state.air.grid.shape[1:3]
    wave = 1e-6 * np.outer(np.sin(np.pi * np.linspace(0, 1, nx)), np.sin(np.pi * np.linspace(0, 1, ny)))
    state.memory[0, NOISE_COLUMNS:].reshape(2, nx, ny)[:] = wave
    go_on(wind, state, 100.0, 1.0)
    rate = 1.0 * np.pi**2 * (1 / 100**2 + 1 / 60**2)  # K / 2 = 1 m^2/s
    found = state.memory[0, NOISE_COLUMNS:].reshape(2, nx, ny)[0, nx // 2, ny // 2] / 1e-6
    # half a wave over 24 cells: the second difference is 0.15 % low; the Euler step adds rate^2 dt / 2
    assert abs(math.log(found) / (-rate * 100.0) - 1.0) < 0.01


def test_an_hour_of_strong_turbulence_stays_within_the_bounds_of_its_edges() -> None:
    wind = TurbulentWind(noise_std=1.41, noise_bandwidth=0.2, noise_damping=0.1, diffusivity=0.01)  # far too coarse
    state = begun(wind, np.arange(4))
    highest = np.abs(state.air.grid).max()
    for _ in range(1800):
        go_on(wind, state, 2.0, 2.0)
        grid = np.abs(state.air.grid[:, :, :, 0, :2])
        assert np.all(np.isfinite(grid))
        highest = max(highest, *(grid[:, i, j].max() for i in (0, -1) for j in (0, -1)))
        assert grid.max() <= highest


def test_a_tick_too_coarse_for_the_grid_is_refused() -> None:
    with pytest.raises(ValueError, match=r"nodes = 200: .*substeps"):
        TurbulentWind(nodes=200, diffusivity=5000.0, step=10.0).check(ARENA)
    TurbulentWind().check(ARENA)
    with pytest.raises(ValueError, match="4 GiB"):
        TurbulentWind(nodes=200).allocate(100_000, ARENA)


def test_a_series_is_interpolated_held_and_looped() -> None:
    series = {"times": [10.0, 20.0, 40.0], "velocities": [[1, 0, 0], [0, 2, 0.5], [1, 0, 0]]}
    wind, looped = SeriesWind(**series), SeriesWind(**series, loop=True)
    for at, expected in (
        (-5.0, (1, 0, 0)),
        (10, (1, 0, 0)),
        (15, (0.5, 1, 0.25)),
        (35, (0.75, 0.5, 0.125)),
        (99, (1, 0, 0)),
    ):
        np.testing.assert_allclose(velocities(begun(wind, [0], at))[0], expected, atol=1e-12)
    for at in (15.0, 45.0, 15.0 - 90.0, 15.0 + 30.0 * 1000):
        np.testing.assert_allclose(velocities(begun(looped, [0], at))[0], (0.5, 1.0, 0.25), atol=1e-9)
    np.testing.assert_allclose(wind.draw(np.array([0])), [[0.5, 1.0, 0.25]])
    one = SeriesWind(times=[5.0], velocities=[[0, 0, 0]])
    assert not one.changes
    assert np.all(velocities(begun(one, [0], 7.0)) == 0)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"times": [0, 10, 10], "velocities": [[0, 0, 0]] * 3}, r"times\[2\] = 10: must be above times\[1\] = 10"),
    ({"times": [0, 10], "velocities": [[0, 0, 0]]}, "velocities = 1 entries"),
    ({"times": [0, 10], "velocities": [[0, 0, 0], [1, 0, 0]], "loop": True}, "must have two entries"),
    ({"times": [], "velocities": []}, "at least 1"),
    ({"times": [0, math.nan], "velocities": [[0, 0, 0]] * 2}, "finite"),
    ({"velocities": [[0, 0]] * 3}, "velocities"),
]


@pytest.mark.parametrize(("parameters", "complaint"), BAD)
def test_bad_series_are_refused(parameters: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ValidationError, match=complaint):
        SeriesWind(**parameters)


@pytest.mark.parametrize("wind", CHANGING, ids=lambda wind: wind.kind)
@pytest.mark.parametrize("setting", SETTINGS, ids=["fixed", "turned"])
def test_a_world_does_not_depend_on_the_batch(wind: Wind, setting: dict[str, Any]) -> None:
    wind = wind.model_copy(update=setting)
    many, alone = begun(wind, [7, 8, 9]), begun(wind, [9])
    places = [(1.0, 2.0, 3.0), (47.0, 31.0, 5.0)]
    for k in range(5):
        due = np.array([k != 2, True, True])  # a world that waits does not hold up another
        before = [velocities(many, *place)[0].copy() for place in places]
        wind.advance(many, due, np.full(3, 0.5 * (k + 1)), 0.5)
        wind.advance(alone, np.ones(1, np.bool_), np.full(1, 0.5 * (k + 1)), 0.5)
        for place, old in zip(places, before, strict=True):
            assert velocities(many, *place)[2].tobytes() == velocities(alone, *place)[0].tobytes()
            assert k != 2 or np.array_equal(velocities(many, *place)[0], old)
    kept = velocities(many)[1].copy()
    wind.begin(many, np.array([2, 0]), np.array([7, 9]), 0.0)
    fresh = begun(wind, [9, 3, 7])
    assert np.array_equal(velocities(many)[[0, 2]], velocities(fresh)[[0, 2]])
    assert np.array_equal(velocities(many)[1], kept)
