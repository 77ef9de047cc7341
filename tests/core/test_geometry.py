"""Obstacles for compiled code: every answer against brute force, on random boxes, cylinders and grids."""

from __future__ import annotations

import math

import numpy as np
import pytest

from osl_env.geometry import (
    OUTLET,
    SOLID,
    Geometry,
    clear_share,
    first_hit,
    flight_share,
    is_outlet,
    is_solid,
    is_taken,
    open_air,
    range_readings,
    ray_distance,
)

AREA = np.array([10.0, 8.0, 5.0])


def random_geometry(seed: int, boxes: int = 3, cylinders: int = 3, grid: bool = True) -> Geometry:
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, AREA - 2, (boxes, 3))
    lows, sides = rng.uniform(0, 8, (cylinders, 2)), rng.uniform(0.2, 1.2, (cylinders, 3))
    bottoms = rng.uniform(0, 3, cylinders)
    cells = np.zeros((7, 6, 5), np.uint8)
    if grid:
        cells[rng.random(cells.shape) < 0.12] = SOLID
        cells[0, 0, :] = OUTLET
    return Geometry(
        np.concatenate([low, low + rng.uniform(0.1, 2.0, (boxes, 3))], axis=1),
        np.column_stack([lows, sides[:, 0], bottoms, bottoms + 3 * sides[:, 1]]),
        cells if grid else np.empty((0, 0, 0), np.uint8),
        np.array([1.0, 0.5, 0.0]),
        np.array([1.1, 0.9, 0.8]),
        0.05,
    )


def brute_solid(g: Geometry, p: np.ndarray, margin: float = 0.0) -> np.ndarray:
    """(..) bool: whether the places `p` (.., 3) are within a solid grown by `margin`, written for clarity."""
    x, y, z = np.moveaxis(p, -1, 0)
    inside = np.zeros(p.shape[:-1], bool)
    for b in g.boxes:
        inside |= ((p >= b[:3] - margin) & (p <= b[3:] + margin)).all(axis=-1)
    for c in g.cylinders:
        inside |= (np.hypot(x - c[0], y - c[1]) <= c[2] + margin) & (z >= c[3] - margin) & (z <= c[4] + margin)
    for cell in np.argwhere(g.cells == SOLID):
        low = g.origin + cell * g.spacing
        inside |= ((p >= low - margin) & (p <= low + g.spacing + margin)).all(axis=-1)
    return inside


def random_segments(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-0.5, AREA + 0.5, (2, n, 3))
    along = rng.random((n, 3)) < 0.25  # many are parallel to an axis or a plane
    return a, np.where(along, a, b)


@pytest.mark.parametrize("seed", range(4))
def test_is_solid_is_membership(seed: int) -> None:
    g = random_geometry(seed)
    places = np.random.default_rng(seed).uniform(-0.5, AREA + 0.5, (3000, 3))
    np.testing.assert_array_equal([is_solid(g, *p) for p in places], brute_solid(g, places))
    np.testing.assert_array_equal([is_taken(g, *p) for p in places], brute_solid(g, places, 0.05))


def test_an_outlet_is_no_solid() -> None:
    g = random_geometry(0)
    place = g.origin + 0.5 * g.spacing
    empty = g._replace(boxes=np.empty((0, 6)), cylinders=np.empty((0, 5)))
    assert is_outlet(g, *place)
    assert not is_solid(empty, *place)
    assert not is_outlet(g, *AREA)
    assert not is_outlet(open_air(), 1.0, 1.0, 1.0)


@pytest.mark.parametrize("seed", range(8))
def test_clear_share_is_where_brute_force_first_finds_a_solid(seed: int) -> None:
    g = random_geometry(seed, grid=seed % 2 == 0)
    t = np.linspace(0.0, 1.0, 4001)
    for a, b in zip(*random_segments(seed, 300), strict=True):
        share = clear_share(g, *a, *b)
        solid = brute_solid(g, a + t[:, None] * (b - a))
        first = t[solid.argmax()] if solid.any() else 1.0
        if solid[0]:
            assert share == 0.0
        else:  # samples are 1/4000 apart; a grazed corner may lie between two
            assert share <= first + 1e-9
            entry = a + min(share + 1e-7, 1.0) * (b - a)
            assert share > first - 1 / 4000 - 1e-9 or brute_solid(g, entry, 1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_line_of_sight_is_the_same_both_ways(seed: int) -> None:
    g = random_geometry(seed)
    for a, b in zip(*random_segments(seed + 50, 500), strict=True):
        assert (clear_share(g, *a, *b) == 1.0) == (clear_share(g, *b, *a) == 1.0)


@pytest.mark.parametrize("margin", [0.0, 0.05, 1.0])
def test_solid_cells_are_the_same_boxes(margin: float) -> None:
    g = random_geometry(5, boxes=0, cylinders=0)
    low = g.origin + np.argwhere(g.cells == SOLID) * g.spacing
    boxes = g._replace(boxes=np.concatenate([low, low + g.spacing], axis=1), cells=np.empty((0, 0, 0), np.uint8))
    for a, b in zip(*random_segments(9, 600), strict=True):
        np.testing.assert_allclose(first_hit(g, margin, *a, *b)[0], first_hit(boxes, margin, *a, *b)[0], atol=1e-12)


def test_nothing_slips_between_cells_that_touch_at_an_edge() -> None:
    cells = np.zeros((4, 4, 1), np.uint8)
    cells[1, 2, 0] = cells[2, 1, 0] = SOLID
    g = open_air()._replace(cells=cells)
    assert clear_share(g, 0.5, 0.5, 0.5, 3.5, 3.5, 0.5) == pytest.approx(0.5)
    assert clear_share(g, 3.5, 3.5, 0.5, 0.5, 0.5, 0.5) == pytest.approx(0.5)
    assert flight_share(g, 0.5, 0.5, 0.5, 3.5, 3.5, 0.5)[0] < 0.5


def test_hits_and_normals_of_a_box_and_a_cylinder_are_exact() -> None:
    box = open_air()._replace(boxes=np.array([[2.0, 2.0, 0.0, 4.0, 4.0, 2.0]]))
    assert first_hit(box, 0.0, 0.0, 3.0, 1.0, 8.0, 3.0, 1.0) == (0.25, -1.0, 0.0, 0.0)
    assert first_hit(box, 0.5, 3.0, 3.0, 4.5, 3.0, 3.0, 0.5) == (0.5, 0.0, 0.0, 1.0)
    assert first_hit(box, 0.0, 3.0, 3.0, 1.0, 9.0, 9.0, 9.0)[0] == 0.0  # begins inside
    post = open_air()._replace(cylinders=np.array([[3.0, 3.0, 1.0, 0.0, 2.0]]))
    assert first_hit(post, 0.0, 0.0, 3.0, 1.0, 4.0, 3.0, 1.0) == (0.5, -1.0, 0.0, 0.0)
    assert first_hit(post, 0.0, 3.0, 3.0, 4.0, 3.0, 3.0, 0.0) == (0.5, 0.0, 0.0, 1.0)
    assert first_hit(post, 0.0, 0.0, 0.0, 3.0, 5.0, 5.0, 3.0)[0] == 1.0  # passes above it
    share, u, v, _ = first_hit(post, 0.0, 0.0, 0.0, 1.0, 3.0, 3.0, 1.0)
    assert share == pytest.approx(1 - 1 / math.hypot(3, 3), abs=1e-15)
    assert (u, v) == pytest.approx((-math.sqrt(0.5), -math.sqrt(0.5)))


@pytest.mark.parametrize("seed", range(6))
def test_where_a_flight_ends_is_free(seed: int) -> None:
    """From a free place, however it is chosen; flights on from there too, also along and into the surface."""
    g = random_geometry(seed, grid=seed % 3 > 0)
    rng = np.random.default_rng(seed)
    place, at = np.array([0.1, 7.9, 4.9]), 0.0
    assert not is_taken(g, *place)
    for n in range(2000):
        step = rng.normal(size=3) * 10.0 ** rng.uniform(-9, 1, 3)
        goal = np.clip(place + step, 0.0, AREA)
        share, *normal = flight_share(g, *place, *goal)
        at += share
        if 0.0 < share < 1.0:
            assert np.linalg.norm(normal) == pytest.approx(1.0)
            assert np.dot(normal, goal - place) < 0.0
        place = goal if share == 1.0 else place + share * (goal - place)
        assert not is_taken(g, *place), n
    assert at > 100.0  # and it was not stuck


def test_rays_reach_the_first_surface_or_bound() -> None:
    g = open_air()._replace(boxes=np.array([[4.0, 0.0, 0.0, 5.0, 8.0, 2.0]]))
    assert ray_distance(g, AREA, 1.0, 4.0, 1.0, 1.0, 0.0, 0.0, 20.0) == 3.0
    assert ray_distance(g, AREA, 1.0, 4.0, 3.0, 1.0, 0.0, 0.0, 20.0) == 9.0
    assert ray_distance(g, AREA, 1.0, 4.0, 3.0, 1.0, 0.0, 0.0, 5.0) == 5.0
    assert ray_distance(g, AREA, 1.0, 4.0, 1.0, -0.6, 0.8, 0.0, 20.0) == pytest.approx(1 / 0.6)
    out = np.zeros((1, 2, 4))
    range_readings(g, AREA, np.array([[[1.0, 4.0, 1.0], [9.0, 1.0, 1.0]]]), 4, 6.0, out)
    np.testing.assert_array_equal(out[0], [[3.0, 4.0, 1.0, 4.0], [1.0, 6.0, 4.0, 1.0]])


@pytest.mark.parametrize("seed", range(3))
def test_rays_against_steps_along_them(seed: int) -> None:
    g = random_geometry(seed)
    places = np.random.default_rng(seed).uniform(0, AREA, (1, 40, 3))
    places = places[:, [not is_solid(g, *p) for p in places[0]]]
    out = np.zeros((1, places.shape[1], 12))
    range_readings(g, AREA, places, 12, 4.0, out)
    step = np.arange(0.0, 4.0005, 0.001)
    for i, place in enumerate(places[0]):
        for r in range(12):
            angle = 2 * math.pi * r / 12
            ray = place + step[:, None] * np.array([math.cos(angle), math.sin(angle), 0.0])
            stops = brute_solid(g, ray) | ((ray < -1e-9) | (ray > AREA + 1e-9)).any(axis=-1)
            first = step[stops.argmax()] if stops.any() else 4.0
            assert out[0, i, r] == pytest.approx(first, abs=2e-3)
