"""Filaments among walls, outlets and rotors: nothing passes a wall, outlets remove, line of sight, downwash."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from osl_env.air import Air, uniform_air
from osl_env.arena import Arena
from osl_env.geometry import FREE, OUTLET, SOLID, Geometry, clear_share, open_air
from osl_env.plumes.base import Scene
from osl_env.plumes.downwash import Downwash, wake_velocities
from osl_env.plumes.filament import FilamentPlume

AREA = (20.0, 12.0, 6.0)
SOURCE = (3.0, 6.0, 3.0)
FAR_AWAY = (1e3, 1e3, 1e3)  # m, of UAVs that disturb nothing


def scene(geometry: Geometry, wind: Any = (1.0, 0.0, 0.0), source: Any = SOURCE, uavs: Any = (FAR_AWAY,)) -> Scene:
    air = uniform_air(1)
    air.mean[:] = wind
    return Scene(np.array([[source]]), np.ones((1, 1)), air, geometry, np.array(AREA), np.array([uavs], float))


def run(plume: FilamentPlume, at: Scene, seconds: float, seed: int = 0) -> Any:
    state = plume.allocate(1, 1, Arena(size=AREA))
    plume.begin(state, at, np.zeros(1, np.int64), np.array([seed]))
    for _ in range(round(seconds / plume.step)):
        plume.advance(state, at, np.ones(1, bool))
    return state


def grid(cells: np.ndarray, side: float) -> Geometry:
    return open_air()._replace(cells=cells, origin=np.zeros(3), spacing=np.full(3, side))


def boxes(*corners: tuple[float, ...]) -> Geometry:
    return open_air()._replace(boxes=np.array(corners))


def cut_in_two(seed: int) -> tuple[Geometry, np.ndarray]:
    """A thin wall across the arena, bent at random, in an occupancy grid of 0.5 m, and where it is along x by y."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((40, 24, 12), np.uint8)
    at = np.clip(14 + np.cumsum(rng.integers(-1, 2, 24)), 8, 30)
    for j in range(24):
        low, high = sorted((at[j], at[max(j - 1, 0)]))
        cells[low : high + 1, j] = SOLID
    cells[0:4][rng.random((4, 24, 12)) < 0.1] = SOLID
    cells[5:8, 11:13, 5:7] = FREE
    return grid(cells, 0.5), at


@pytest.mark.parametrize("seed", range(4))
def test_nothing_passes_a_wall_of_cells(seed: int) -> None:
    """A step (3 m and more) is many times the wall's thickness (0.5 m)."""
    geometry, at = cut_in_two(seed)
    plume = FilamentPlume(filament_rate=40.0, diffusion=1.5, step=1.0, max_age=40.0)
    f = plume.filaments(run(plume, scene(geometry, wind=(3.0, 0.5, -0.3)), 30.0, seed), 0)
    assert len(f.ages) > 200
    i, j, k = np.floor(f.positions / 0.5).astype(int).clip(0, np.array([39, 23, 11])).T
    assert (geometry.cells[i, j, k] == FREE).all()
    assert (i < at[j] + 1).all()


def test_nothing_passes_a_wall_of_boxes_and_cylinders() -> None:
    """A closed room of thin plates around a column: all that is released stays in it, outside the column."""
    t = 0.01
    room = [
        (1.0, 3.0, 0.0, 1.0 + t, 9.0, 5.0),
        (8.0, 3.0, 0.0, 8.0 + t, 9.0, 5.0),
        (1.0, 3.0, 0.0, 8.0 + t, 3.0 + t, 5.0),
        (1.0, 9.0, 0.0, 8.0 + t, 9.0 + t, 5.0),
        (1.0, 3.0, 5.0, 8.0 + t, 9.0 + t, 5.0 + t),
    ]
    geometry = boxes(*room)._replace(cylinders=np.array([[5.5, 6.0, 0.8, 0.0, 6.0]]))
    plume = FilamentPlume(filament_rate=20.0, diffusion=2.0, step=1.0, rise=0.5)
    f = plume.filaments(run(plume, scene(geometry, wind=(4.0, 1.0, 0.0)), 40.0), 0)
    assert len(f.ages) == 800
    assert (f.positions > (1.0, 3.0, -1e-9)).all()
    assert (f.positions < (8.0, 9.0, 5.0)).all()
    assert (np.hypot(*(f.positions[:, :2] - (5.5, 6.0)).T) > 0.8).all()


def test_filaments_slide_along_walls() -> None:
    """Carried at a plate at 45 degrees, they go on along it."""
    geometry = boxes((6.0, 0.0, 0.0, 6.5, 12.0, 6.0))
    plume = FilamentPlume(diffusion=0.0, filament_rate=5.0)
    f = plume.filaments(run(plume, scene(geometry, wind=(0.5, 0.5, 0.0), source=(3.0, 2.0, 3.0)), 16.0), 0)
    assert f.positions[:, 0].max() < 6.0
    assert f.positions[:, 1].max() > 9.0


def test_outlets_remove_what_meets_them_even_in_one_step() -> None:
    """An outlet of one cell's thickness, with a solid behind it, at a step of six cells."""
    cells = np.zeros((40, 24, 12), np.uint8)
    cells[20], cells[21:] = OUTLET, SOLID
    plume = FilamentPlume(diffusion=0.1, step=1.0, filament_rate=10.0)
    state = run(plume, scene(grid(cells, 0.5), wind=(3.0, 0.0, 0.0)), 20.0)
    f = plume.filaments(state, 0)
    assert f.positions[:, 0].max() < 10.0
    assert len(f.ages) == pytest.approx(10 * 7 / 3, abs=2)


def test_walls_far_away_change_nothing_but_rounding() -> None:
    """Without noise to 1e-5; with noise rounding may change the order in memory, and with it who gets which draw."""
    open_world, walled = scene(open_air()), scene(boxes((500.0, 500.0, 0.0, 501.0, 501.0, 1.0)))
    plume = FilamentPlume(filament_rate=20.0, diffusion=0.0)
    free, among = run(plume, open_world, 15.0), run(plume, walled, 15.0)
    points = np.random.default_rng(0).uniform((0, 0, 0), AREA, (200, 3))
    np.testing.assert_allclose(plume.at(among, walled, 0, points), plume.at(free, open_world, 0, points), rtol=1e-5)
    noisy = FilamentPlume(filament_rate=200.0, diffusion=0.3)
    first, second = (noisy.filaments(run(noisy, at, 15.0), 0) for at in (open_world, walled))
    assert len(first.ages) == pytest.approx(len(second.ages), rel=0.01)
    error = first.positions.std(axis=0) * np.sqrt(2 / len(first.ages))  # of the difference of two means
    assert np.all(np.abs(first.positions.mean(axis=0) - second.positions.mean(axis=0)) < 5 * error)


def test_a_filament_counts_only_where_it_is_seen() -> None:
    geometry = boxes((3.4, 0.0, 0.0, 3.5, 12.0, 6.0))
    behind, before = np.array([3.8, 6.0, 3.0]), np.array([2.2, 6.0, 3.0])
    for seen in (True, False):
        plume = FilamentPlume(diffusion=0.0, filament_rate=5.0, line_of_sight=seen)
        at = scene(geometry, wind=(0.0, 0.0, 0.0))
        state = run(plume, at, 4.0)
        assert (plume.at(state, at, 0, behind) > 0) == (not seen)
        assert plume.at(state, at, 0, before) > 0
    assert clear_share(geometry, 3.0, 6.0, 3.0, *behind) < 1.0


def test_air_on_a_grid_carries_as_uniform_air_does() -> None:
    """A grid with the same velocity everywhere: the same plume, to rounding; a shear turns it."""
    plume = FilamentPlume(filament_rate=20.0)
    uniform = scene(open_air())
    frames = np.zeros((1, 5, 4, 3, 3), np.float32)
    frames[..., 0] = 1.0
    air = uniform_air(1)
    gridded = Air(air.mean, frames, air.frame, air.blend, np.full(3, 1.0), np.array([4.0, 3.0, 2.0]))
    at = Scene(uniform.sources, uniform.strengths, gridded, open_air(), uniform.area, uniform.positions)
    one, two = plume.filaments(run(plume, uniform, 10.0), 0), plume.filaments(run(plume, at, 10.0), 0)
    np.testing.assert_allclose(two.positions.mean(axis=0), one.positions.mean(axis=0), atol=1e-4)
    frames[..., 1] = np.linspace(0.0, 0.5, 5)[:, None, None]
    assert plume.filaments(run(plume, at, 10.0), 0).positions[:, 1].mean() > one.positions[:, 1].mean() + 0.5


def test_downwash_is_off_by_default_and_follows_momentum_theory() -> None:
    assert FilamentPlume().downwash is None
    wash = Downwash()
    v = wash.induced_velocity
    assert v == pytest.approx(math.sqrt(2.4 * 9.80665 / (2 * 1.2 * 0.36)))
    radius = wash.wake.radius
    depths = np.array([0.0, 3 * radius, 4.0, 8.0, -3 * radius])
    out = np.empty(5)
    wake = Downwash(depth=20.0).wake
    wake_velocities(wake, depths, np.zeros(5), out)
    assert out[0] == pytest.approx(v)
    assert 1.9 * v < out[1] < 2 * v
    assert out[2] == pytest.approx(2 * out[3])  # a jet: 1 / s
    assert out[4] == 0.0


def test_downwash_moves_down_dilutes_and_keeps_mass() -> None:
    above = [(6.0, 6.0, 4.5)]
    figures = {}
    for name, wash, uavs in (("calm", None, above), ("far", Downwash(), [FAR_AWAY]), ("blown", Downwash(), above)):
        plume = FilamentPlume(downwash=wash, diffusion=0.1, sigma=0.1, growth=0.001, filament_rate=100.0, step=0.1)
        at = scene(open_air(), wind=(0.5, 0.0, 0.0), uavs=uavs)
        state = run(plume, at, 10.0)
        figures[name] = plume.filaments(state, 0)
        assert figures[name].contents.sum() == pytest.approx(1000 * plume.content, rel=1e-5)
    calm, far, blown = figures["calm"], figures["far"], figures["blown"]
    np.testing.assert_array_equal(calm.positions, far.positions)
    past = blown.positions[:, 0] > 7.0
    assert blown.positions[past, 2].mean() < calm.positions[calm.positions[:, 0] > 7.0, 2].mean() - 1.0
    assert (blown.positions[:, 2] >= 0).all()
    assert blown.sigmas[past].mean() > 1.5 * calm.sigmas[calm.positions[:, 0] > 7.0].mean()
    before = blown.positions[:, 0] < 4.5
    assert blown.positions[before, 2].mean() == pytest.approx(3.0, abs=0.1)
