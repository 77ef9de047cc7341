"""The chemotaxis gradient: exact on planes, equivariant, right where positions have no full rank; its rank rules."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from baselines.chemotaxis.gradient import Rule, Window, least_squares
from osl_env.parameters import FloatArray

EPSILON = float(np.finfo(np.float64).eps)
N = 20


def fit(
    positions: FloatArray, readings: FloatArray, relative: float = N * EPSILON
) -> tuple[int, FloatArray, FloatArray]:
    """Rank, gradient and the direction over which the positions spread least."""
    out = np.zeros((2, 3))
    rank = least_squares(np.column_stack([positions, readings]), relative, 0.0, out)
    return rank, out[0], out[1]


def rotation(rng: np.random.Generator) -> FloatArray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.diag(r)))


def window(rule: Rule, seed: int = 0, jitter: float = 1e-9, spread: float = 0.02) -> Window:
    return Window(N, rule, jitter, spread, np.random.default_rng(seed))


def fill(target: Window, positions: FloatArray, readings: FloatArray) -> Window:
    for (x, y, z), c in zip(positions.tolist(), readings.tolist(), strict=True):
        target.add(x, y, z, c)
    return target


def line(along: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> FloatArray:
    """N places on a straight flight from (12, 7, 4) m."""
    return np.array([12.0, 7.0, 4.0]) + np.arange(N)[:, None] * 0.07 * np.array(along)


def test_a_linear_field_has_its_gradient() -> None:
    """To rounding: readings of size 50 carry errors of 1e-14, the positions spread over a metre."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        slope, positions = rng.normal(size=3), rng.uniform(0.0, 30.0) + rng.normal(size=(N, 3))
        rank, gradient, _ = fit(positions, positions @ slope + 5.0)
        assert rank == 3
        np.testing.assert_allclose(gradient, slope, atol=1e-12)


def test_it_is_the_least_squares_solution_and_turns_with_the_world() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        positions, readings = rng.normal(size=(N, 3)) * [1.0, 0.1, 0.01], rng.exponential(size=N)
        gradient = fit(positions, readings)[1]
        centred = positions - positions.mean(axis=0)
        expected = np.linalg.lstsq(centred, readings - readings.mean(), rcond=None)[0]
        np.testing.assert_allclose(gradient, expected, rtol=1e-9)
        turned, moved = rotation(rng), rng.uniform(-20.0, 20.0, 3)
        np.testing.assert_allclose(fit(positions @ turned.T + moved, readings)[1], turned @ gradient, rtol=1e-7)
        np.testing.assert_allclose(fit(positions, 3.0 * readings - 7.0)[1], 3.0 * gradient, rtol=1e-9)


def test_rank_and_least_norm_on_a_line_and_in_a_plane() -> None:
    rng = np.random.default_rng(3)
    for rank in (0, 1, 2, 3):
        turned = rotation(rng)
        local = rng.normal(size=(N, 3)) * (np.arange(3) < rank)
        positions, readings = local @ turned.T, rng.normal(size=N)  # exactly in the span of `rank` directions or nearly
        found, gradient, weakest = fit(positions, readings, relative=1e-12)
        assert found == rank
        missing = turned[:, rank:]
        np.testing.assert_allclose(missing.T @ gradient, 0.0, atol=1e-9)
        if rank == 2:
            np.testing.assert_allclose(abs(missing[:, 0] @ weakest), 1.0, atol=1e-12)
        if rank:
            pseudo = np.linalg.pinv(positions - positions.mean(axis=0), rcond=1e-12)
            np.testing.assert_allclose(gradient, pseudo @ (readings - readings.mean()), atol=1e-9)


def test_small_spreads_keep_their_weight() -> None:
    """1e-9 m beside 1 m: the normal equations lose it (1e-18 < epsilon); here it gives its slope to 1e-5.

    Readings of size 1 are rounded to 1e-16, 1e-7 of what a nanometre makes of them; the positions, of size 10, to
    1e-15: 1e-6 of a nanometre.
    """
    rng = np.random.default_rng(4)
    offsets = np.column_stack([1e-9 * rng.normal(size=N), np.linspace(-0.7, 0.7, N), 1e-9 * rng.normal(size=N)])
    positions = np.array([10.0, 3.0, 5.0]) + offsets
    exact = positions - positions[0]
    rank, gradient, _ = fit(positions, exact @ np.array([2.0, 0.5, -1.0]))
    assert rank == 3
    np.testing.assert_allclose(gradient, [2.0, 0.5, -1.0], rtol=1e-5)


def test_the_window_holds_the_last_readings() -> None:
    """After N readings of one field and N of another, only the other's gradient is left."""
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, N, 3))
    held = window("minimum_norm")
    fill(held, first[:-1], first[:-1] @ [1.0, 0.0, 0.0])
    assert not held.full
    fill(held, first[-1:], first[-1:] @ [1.0, 0.0, 0.0])
    assert held.full
    np.testing.assert_allclose(held.direction(), [1.0, 0.0, 0.0], atol=1e-12)
    fill(held, second, second @ [0.0, 3.0, -4.0])
    np.testing.assert_allclose(held.direction(), [0.0, 0.6, -0.8], atol=1e-12)
    held.clear()
    assert not held.full


def curved(positions: FloatArray) -> FloatArray:
    """Readings that no plane fits."""
    return np.exp(-0.5 * ((positions - [11.0, 8.0, 4.5]) ** 2).sum(axis=1))


@pytest.mark.parametrize("along", [(0.0, 1.0, 0.0), (0.6, 0.0, 0.8)])
def test_rank_rules_on_a_straight_flight(along: tuple[float, float, float]) -> None:
    positions = line(along)
    readings = curved(positions)
    direction = np.array(along)
    assert fill(window("printed"), positions, readings).direction() is None
    kept = np.array(fill(window("minimum_norm"), positions, readings).direction())
    np.testing.assert_allclose(np.abs(kept @ direction), 1.0, atol=1e-9)
    probing = fill(window("probe"), positions, readings)
    assert abs(np.array(probing.direction()) @ direction) < 1e-9
    assert probing.probing
    shaken = np.array([fill(window("jitter", seed), positions, readings).direction() for seed in range(30)])
    np.testing.assert_allclose(np.linalg.norm(shaken, axis=1), 1.0)
    assert (np.abs(shaken @ direction) < 0.1).all()  # across the line
    assert np.linalg.norm(shaken.mean(axis=0)) < 0.5  # to any side: 30 random ones average to 0.18
    np.testing.assert_array_equal(fill(window("jitter", 7), positions, readings).direction(), shaken[7])


@pytest.mark.parametrize("rule", ["jitter", "probe", "printed", "minimum_norm"])
def test_all_rules_agree_where_there_is_full_rank(rule: Rule) -> None:
    """Jitter of 1e-9 m moves a direction by about as much."""
    positions = np.random.default_rng(6).normal(size=(N, 3))
    direction = fill(window(rule), positions, positions @ [2.0, -1.0, 2.0]).direction()
    np.testing.assert_allclose(direction, np.array([2.0, -1.0, 2.0]) / 3.0, atol=1e-8)


def test_probing_finds_the_gradient_from_any_straight_flight() -> None:
    """In a linear field: a few probes of 7 cm give the rank, and the direction then is exact. It keeps to its side."""
    slope = np.array([1.0, 2.0, -2.0]) / 3.0
    for seed in range(10):
        held = fill(window("probe", seed), line(), line() @ slope)
        place, directions = line()[-1], []
        for _ in range(20):
            direction = np.array(held.direction())
            if not held.probing:
                break
            directions.append(direction)
            place = place + 0.07 * direction
            held.add(*place.tolist(), float(place @ slope))
        np.testing.assert_allclose(direction, slope, atol=1e-9)
        assert 2 <= len(directions) <= 8
        assert min(a @ b for a, b in itertools.pairwise(directions)) > -1e-9


def test_a_probe_turns_back_where_its_way_is_closed() -> None:
    held = fill(window("probe"), line(), curved(line()))
    first = np.array(held.direction())
    np.testing.assert_array_equal(held.turn_back(), -first)
    np.testing.assert_allclose(np.array(held.direction()) @ first, -1.0)


def test_equal_readings_have_no_gradient() -> None:
    """A saturated sensor, or clean air: on in the last direction; `printed` has none to go on in."""
    positions, flat = np.random.default_rng(8).normal(size=(N, 3)) + 10.0, np.full(N, 0.3)
    for rule in ("jitter", "probe", "minimum_norm"):
        held = window(rule)  # type: ignore[arg-type]
        held.head(0.0, 3.0, 4.0)
        assert fill(held, positions, flat).direction() == (0.0, 0.6, 0.8)
        fill(held, positions, positions @ [0.0, 0.0, 1.0])
        before = held.direction()
        assert fill(held, positions, flat).direction() == before
        blank = fill(window(rule), positions, flat)  # type: ignore[arg-type]
        np.testing.assert_allclose(np.linalg.norm(blank.direction()), 1.0)
    assert fill(window("printed"), positions, flat).direction() is None


def test_at_rest_the_rules_do_as_they_say() -> None:
    still, readings = np.full((N, 3), 5.0), np.random.default_rng(9).exponential(size=N)
    assert fill(window("printed"), still, readings).direction() is None
    for rule in ("jitter", "probe", "minimum_norm"):
        direction = fill(window(rule), still, readings).direction()  # type: ignore[arg-type]
        np.testing.assert_allclose(np.linalg.norm(direction), 1.0)
