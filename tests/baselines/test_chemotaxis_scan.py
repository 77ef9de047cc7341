"""The chemotaxis scan: the paper's pattern, its mirror images, its strips, and what it covers."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.chemotaxis.scan import Pattern, has_other_side, lanes, layer_heights, scan_round, turns
from osl_env.parameters import FloatArray

AREA = np.array([30.0, 30.0, 10.0])
SHIFT = np.array([10.0, 15.0, -1.0])  # arena = paper + this
STARTS = [(15, -12, 4), (18, 12, 10), (16, 0, 8), (17, -8, 6), (15, 10, 9)]  # the paper's Initial 1 to 5


def round_of(start: tuple[float, float, float], **changes: object) -> FloatArray:
    """The first round from a start of the paper, in the paper's coordinates."""
    begin = np.array(start) + SHIFT
    pattern = Pattern(**changes)  # type: ignore[arg-type]
    return scan_round(begin, AREA, pattern, layer_heights(begin[2], AREA[2], 3)) - SHIFT


def test_heights_are_the_paper_s() -> None:
    """Initial 1 rises by (11 - 4) / 3 to 6.33 m, as printed; 6 m is not above 6 m; 10 m sinks by (10 - 1) / 3."""
    for start, expected in [(4, (4, 6.33, 8.67)), (6, (6, 7.67, 9.33)), (10, (10, 7, 4)), (8, (8, 5.67, 3.33))]:
        np.testing.assert_allclose(layer_heights(start - 1, 10.0, 3) + 1, expected, atol=0.005)
    for start in np.linspace(0.0, 10.0, 21):
        for layers in (1, 2, 5):
            heights = layer_heights(start, 10.0, layers)
            assert heights[0] == start
            assert ((heights >= 0.0) & (heights <= 10.0)).all()
            assert len(set(heights)) == layers


@pytest.mark.parametrize(("start", "first"), list(zip(STARTS, (-13.5, 13.5, 13.5, -13.5, 13.5), strict=True)))
def test_a_layer_of_the_paper(start: tuple[float, float, float], first: float) -> None:
    """To the nearer side, then lanes 4 m apart down to low x, then home at the same height, then the next height."""
    points = round_of(start)
    layers = points.reshape(3, -1, 3)
    for k, layer in enumerate(layers):
        *sweeps, home, above = layer
        np.testing.assert_allclose(sweeps[0], [start[0], first, layer[0, 2]])
        path = np.array(sweeps)
        assert np.ptp(path[:, 2]) == 0.0
        np.testing.assert_allclose(np.abs(path[:, 1]), 13.5)
        steps = np.diff(path, axis=0)
        np.testing.assert_allclose(steps[::2, 1], 0.0, atol=1e-12)  # a shift, then a sweep, and so on
        np.testing.assert_allclose(steps[1::2, 0], 0.0, atol=1e-12)
        np.testing.assert_allclose(np.abs(steps[1::2, 1]), 27.0)
        np.testing.assert_allclose(steps[:-2:2, 0], -4.0)
        assert -4.0 - 1e-9 <= steps[-2, 0] < 0.0  # the last shift stops at the margin
        assert -8.5 <= path[-1, 0] < -10 + 4  # no room for another lane
        np.testing.assert_allclose(home, [start[0], start[1], layer[0, 2]])
        np.testing.assert_allclose(above, [start[0], start[1], layers[(k + 1) % 3, 0, 2]])
    np.testing.assert_allclose(layers[:, 0, 2] + SHIFT[2], layer_heights(start[2] - 1.0, 10.0, 3))


def test_the_first_side_can_be_chosen() -> None:
    ends = {side: turns(0.0, 30.0, 3.0, Pattern(first_side=side)) for side in ("nearer", "farther", "low", "high")}  # type: ignore[arg-type]
    assert ends == {"nearer": (1.5, 28.5), "farther": (28.5, 1.5), "low": (1.5, 28.5), "high": (28.5, 1.5)}
    assert turns(0.0, 30.0, 15.0, Pattern())[0] == 28.5  # as near to both: the high side


@pytest.mark.parametrize("start", STARTS)
def test_turned_patterns_are_mirror_images(start: tuple[float, float, float]) -> None:
    """The volume is as wide as it is long, so that the pattern towards low y is that towards low x with axes swapped.

    A mirrored start has a mirrored pattern. In the middle both sides are as near, so it is moved off it.
    """
    begin = np.array(start) + SHIFT + [0.0, 0.1, 0.0]
    heights = layer_heights(begin[2], 10.0, 3)
    printed = scan_round(begin, AREA, Pattern(), heights)
    mirrored = scan_round(begin * [-1, 1, 1] + [30, 0, 0], AREA, Pattern(towards="high_x"), heights)
    np.testing.assert_allclose(mirrored, printed * [-1, 1, 1] + [30, 0, 0], atol=1e-12)
    swapped = scan_round(begin[[1, 0, 2]], AREA, Pattern(towards="low_y"), heights)
    np.testing.assert_array_equal(swapped, printed[:, [1, 0, 2]])
    assert Pattern(towards="high_y").reversed().towards == "low_y"


@pytest.mark.parametrize("n_strips", [1, 2, 3, 4])
def test_strips_share_the_sweeps(n_strips: int) -> None:
    """Each UAV's way points are in its strip, and the sweeps reach its ends but for the margin."""
    start, heights = np.array([25.0, 3.0, 3.0]), layer_heights(3.0, 10.0, 3)
    width = 30.0 / n_strips
    for strip in range(n_strips):
        points = scan_round(start, AREA, Pattern(), heights, strip, n_strips)
        low = strip * width
        assert points[:, 1].min() >= low
        assert points[:, 1].max() <= low + width
        np.testing.assert_allclose(points[:3, 0], [25.0, 21.0, 21.0])
        np.testing.assert_allclose(np.sort(points[1:3, 1]), [low + 1.5, low + width - 1.5])


def test_every_place_is_near_a_lane_whatever_the_area() -> None:
    """Over both sides of the start each place of the area is less than a lane's shift from a lane."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        side, shift = rng.uniform(0.5, 60.0), rng.uniform(0.5, 10.0)
        start = rng.uniform(0.0, side)
        pattern = Pattern(lane_shift=shift, turn_margin=rng.uniform(0.0, 3.0))
        flown = [start, *lanes(start, side, pattern)]
        if has_other_side(start, side, pattern):
            flown += lanes(start, side, pattern.reversed())
        assert all(0.0 <= lane <= side for lane in flown)
        reach = shift + min(pattern.turn_margin, side / 4.0)
        nearest = np.abs(np.linspace(0.0, side, 200)[:, None] - np.array(flown)[None]).min(axis=1)
        assert nearest.max() <= reach + 1e-9


def test_the_paper_s_starts_have_no_other_side() -> None:
    assert not any(has_other_side(start[0] + 10.0, 30.0, Pattern()) for start in STARTS)
    assert has_other_side(10.0, 30.0, Pattern())


def test_small_areas_are_swept_too() -> None:
    """A strip narrower than four margins, and a start on the floor, in a corner, or beside its strip."""
    area = np.array([7.0, 2.0, 0.5])
    for start in ([0.0, 0.0, 0.0], [7.0, 2.0, 0.5], [6.8, 0.2, 0.1]):
        for strip in range(3):
            points = scan_round(np.array(start), area, Pattern(), layer_heights(start[2], 0.5, 3), strip, 3)
            assert ((points >= 0.0) & (points <= area)).all()
            assert np.ptp(points[:, 1]) > 0.3  # the strips are 0.67 m wide
