"""GaSLAM's maps: the cells, 3D Kernel DM+V/W against its formulas written out, gas and no gas, the final map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from baselines.gaslam.cells import PAPER_SHAPE, Cells
from baselines.gaslam.final_map import final_map
from baselines.gaslam.gaseous import gas_threshold, gaseous
from baselines.gaslam.kernel_map import KernelMap, KernelParameters
from osl_env.errors import InputError
from osl_env.parameters import FloatArray

TUNNEL = Cells(np.zeros(3), np.array([7.0, 2.0, 0.5]))
AIR = np.array([0.2, 0.0, 0.0])
WINDS = [(0.0, 0.0, 0.0), (0.7, 0.0, 0.0), (0.0, -0.4, 0.0), (-0.5, 0.8, 0.0), (0.3, -0.2, 0.4), (0.0, 0.0, 1.0)]

Readings = tuple[FloatArray, FloatArray, FloatArray]  # positions (m, 3), concentrations (m,), winds (m, 3)


def readings(n: int, seed: int = 0, cells: Cells = TUNNEL) -> Readings:
    """Readings in and up to 10 % around the cells, in winds of all directions."""
    rng = np.random.default_rng(seed)
    margin = 0.1 * (cells.high - cells.low)
    return (
        rng.uniform(cells.low - margin, cells.high + margin, (n, 3)),
        rng.gamma(1, 100, n),
        rng.normal(0, 0.5, (n, 3)),
    )


def mapped(of: Readings, cells: Cells = TUNNEL, **parameters: Any) -> KernelMap:
    kernel_map = KernelMap(cells, KernelParameters(**parameters))
    for position, concentration, wind in zip(*of, strict=True):
        kernel_map.add(position, concentration, wind)
    return kernel_map


def covariance(wind: FloatArray, p: KernelParameters) -> FloatArray:
    """Sigma written out: axes sigma0 + gamma u along the wind and sigma0 / sqrt(1 + gamma u / sigma0) across it."""
    u = float(np.linalg.norm(wind))
    along, across = p.width + p.stretching * u, p.width / math.sqrt(1 + p.stretching * u / p.width)
    turn = (
        np.linalg.qr(np.column_stack([wind, np.eye(3)]))[0] if u > 0 else np.eye(3)
    )  # its first column lies in the wind
    return turn @ np.diag([along**2, across**2, across**2]) @ turn.T


def written_out(of: Readings, cells: Cells, p: KernelParameters) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean, variance and confidence as in the module's formulas, all readings at once."""
    positions, concentrations, winds = of
    weights = np.zeros((len(concentrations), cells.n))
    for i in range(len(concentrations)):
        d = cells.centres - positions[i]
        square = np.einsum("kd,kd->k", d, np.linalg.solve(covariance(winds[i], p), d.T).T)
        weights[i] = np.where(square <= p.cutoff**2, np.exp(-0.5 * square), 0.0)
    omega = weights.sum(axis=0)
    confidence = 1 - np.exp(-omega / p.confidence_scale)
    reached = np.where(omega > 0, omega, np.inf)
    mean = concentrations @ weights / reached
    if p.shrink_to == "average":
        mean = confidence * mean + (1 - confidence) * concentrations.mean()
    own = [int(np.argmin(np.linalg.norm((cells.centres - place) / cells.size, axis=1))) for place in positions]
    residuals = (concentrations - mean[own]) ** 2
    if p.shrink_to == "nothing":
        residuals[omega[own] == 0] = 0
    variance = residuals @ weights / reached
    if p.shrink_to == "average":
        variance = confidence * variance + (1 - confidence) * residuals.mean()
    return mean, variance, confidence


# --- cells


def test_the_papers_cells() -> None:
    assert TUNNEL.shape == PAPER_SHAPE
    assert TUNNEL.n == 700
    np.testing.assert_allclose(TUNNEL.size, [0.5, 0.2, 0.1])
    same = Cells.of_size(np.zeros(3), (7, 2, 0.5), (0.5, 0.2, 0.1))
    assert same.shape == PAPER_SHAPE
    np.testing.assert_array_equal(same.centres, TUNNEL.centres)
    np.testing.assert_allclose(TUNNEL.centres[[0, 1, 5, 50]], [(0.25, 0.1, 0.05), (0.25, 0.1, 0.15), (0.25, 0.3, 0.05),
                                                               (0.75, 0.1, 0.05)])  # fmt: skip


def test_every_centre_is_in_its_own_cell_and_in_no_nearer_one() -> None:
    cells = Cells((-3, 1, 2), (4, 2, 9), (3, 4, 5))
    for k, centre in enumerate(cells.centres):
        assert cells.index_of(centre) == cells.nearest(centre) == k
    for point in np.random.default_rng(0).uniform((-6, 0, 0), (7, 3, 11), (200, 3)):
        inside = bool(np.all((point >= cells.low) & (point <= cells.high)))
        assert (cells.index_of(point) is not None) == inside
        held = np.clip(point, cells.low, cells.high)  # the nearest cell, in cells along each axis
        expected = np.argmin(np.abs((cells.centres - held) / cells.size).max(axis=1))
        assert cells.nearest(point) == expected


def test_faces_belong_to_the_cells_and_beyond_them_there_is_none() -> None:
    assert TUNNEL.index_of(TUNNEL.low) == 0
    assert TUNNEL.index_of(TUNNEL.high) == TUNNEL.n - 1
    assert TUNNEL.index_of((7.0001, 1, 0.2)) is None
    assert TUNNEL.index_of((math.nan, 1, 0.2)) is None
    with pytest.raises(InputError, match="point"):
        TUNNEL.nearest((math.nan, 1, 0.2))


def test_cells_larger_than_the_box_give_one() -> None:
    cells = Cells.of_size(np.zeros(3), np.ones(3), (9, 9, 9))
    assert cells.shape == (1, 1, 1)
    np.testing.assert_array_equal(cells.centres, [[0.5, 0.5, 0.5]])


@pytest.mark.parametrize(
    ("low", "high", "shape", "match"),
    [
        ((0, 0, 0), (1, 1, 0), (1, 1, 1), "high"),
        ((0, 0, math.nan), (1, 1, 1), (1, 1, 1), "low"),
        ((0, 0), (1, 1, 1), (1, 1, 1), "low"),
        ((0, 0, 0), (1, 1, 1), (1, 0, 1), "shape"),
        ((0, 0, 0), (1, 1, 1), (1, 1.5, 1), "shape"),
        ((0, 0, 0), (1, 1, 1), (1000, 1000, 2), "shape"),
    ],
)
def test_impossible_cells_are_refused(low: Any, high: Any, shape: Any, match: str) -> None:
    with pytest.raises(InputError, match=rf"^cells\.{match} = "):
        Cells(low, high, shape)


def test_a_gas_map_of_a_belief_holds_the_values_in_their_cells() -> None:
    shown = TUNNEL.gas_map(np.arange(700.0))
    assert shown.values.shape == PAPER_SHAPE
    for k in (0, 37, 699):
        place = tuple(((TUNNEL.centres[k] - shown.low) / shown.spacing).astype(int))
        assert shown.values[place] == k
    with pytest.raises(InputError, match="gas map"):
        TUNNEL.gas_map(np.zeros(3))


# --- the kernel map


@pytest.mark.parametrize("shrink_to", ["nothing", "average"])
def test_incremental_is_all_at_once_by_the_formulas(shrink_to: str) -> None:
    """After every hundred readings: rounding alone, 1e-9 of the readings' 100 and of their square."""
    taken = readings(400)
    kernel_map = KernelMap(TUNNEL, parameters := KernelParameters(shrink_to=shrink_to))
    for i, (position, concentration, wind) in enumerate(zip(*taken, strict=True), start=1):
        kernel_map.add(position, concentration, wind)
        if i % 100 == 0:
            so_far = (taken[0][:i], taken[1][:i], taken[2][:i])
            mean, variance, confidence = written_out(so_far, TUNNEL, parameters)
            np.testing.assert_allclose(kernel_map.mean, mean, rtol=1e-9, atol=1e-7)
            np.testing.assert_allclose(kernel_map.variance, variance, rtol=1e-9, atol=1e-5)
            np.testing.assert_allclose(kernel_map.confidence, confidence, rtol=1e-9, atol=1e-12)


def test_the_order_of_the_readings_does_not_matter() -> None:
    taken = readings(300, seed=1)
    order = np.random.default_rng(2).permutation(300)
    one, other = mapped(taken), mapped((taken[0][order], taken[1][order], taken[2][order]))
    np.testing.assert_allclose(other.mean, one.mean, rtol=1e-10)
    np.testing.assert_allclose(other.variance, one.variance, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(other.weight, one.weight, rtol=1e-12)


@pytest.mark.parametrize("wind", WINDS)
def test_weights_are_symmetric_and_do_not_tell_wind_from_headwind(wind: tuple[float, float, float]) -> None:
    """What a reading in cell a weighs in cell b, a reading in b weighs in a."""
    cells = Cells(np.zeros(3), (2, 1.5, 1), (8, 6, 4))
    one_at = [mapped((centre[None], np.ones(1), np.array([wind])), cells, cutoff=10) for centre in cells.centres]
    weights = np.array([kernel_map.weight for kernel_map in one_at])
    # at the end of the kernel, 10 standard deviations, rounding decides: a weight of 2e-22
    np.testing.assert_allclose(weights, weights.T, rtol=1e-11, atol=1e-20)
    np.testing.assert_array_equal(np.diag(weights), 1.0)
    against = mapped((cells.centres[80:81], np.ones(1), -np.array([wind])), cells, cutoff=10)
    np.testing.assert_allclose(against.weight, weights[80], rtol=1e-11, atol=1e-20)


@pytest.mark.parametrize("wind", WINDS)
def test_a_reading_has_the_same_weight_in_every_wind(wind: tuple[float, float, float]) -> None:
    """The kernel's integral is (2 pi)^1.5 sigma0^3, but for the 1.1e-3 beyond 4 standard deviations (in 3D).

    Cells of half the smallest standard deviation, 0.073 m: but for the cut, where weights are below 3.4e-4, the sum is
    the integral to e^(-8 pi^2), and with it to 1e-3.
    """
    cells = Cells((-1.7, -1.7, -1.7), (1.7, 1.7, 1.7), (93, 93, 93))
    total = mapped((np.array([[0.011, 0.002, 0.017]]), np.ones(1), np.array([wind])), cells).weight.sum()
    assert total * np.prod(cells.size) == pytest.approx((1 - 1.134e-3) * (2 * np.pi) ** 1.5 * 0.13**3, rel=1e-3)


def test_the_kernel_is_stretched_along_the_wind_and_round_without() -> None:
    cells = Cells((-1.05, -1.05, -1.05), (1.05, 1.05, 1.05), (21, 21, 21))
    x, y, z = cells.centres.T
    still = mapped((np.zeros((1, 3)), np.ones(1), np.zeros((1, 3))), cells).weight
    np.testing.assert_allclose(
        still,
        np.where(x * x + y * y + z * z <= 0.52**2, np.exp(-(x * x + y * y + z * z) / (2 * 0.13**2)), 0),
        atol=1e-12,
    )
    windy = mapped((np.zeros((1, 3)), np.ones(1), np.array([[0.0, 0.5, 0.0]])), cells).weight
    stretch = 1 + 0.3 * 0.5 / 0.13
    downwind, aside = (int(np.flatnonzero(np.isclose(cells.centres, at, atol=1e-9).all(axis=1))[0])
                       for at in ((0, 0.2, 0), (0.2, 0, 0)))  # fmt: skip
    assert windy[downwind] == pytest.approx(math.exp(-0.5 * (0.2 / (0.13 * stretch)) ** 2), rel=1e-10)
    assert windy[aside] == pytest.approx(math.exp(-0.5 * 0.2**2 * stretch / 0.13**2), rel=1e-10)


def test_turning_the_world_by_90_degrees_turns_the_map() -> None:
    cells = Cells((-1, -1, 0), (1, 1, 0.5), (10, 10, 5))
    positions, concentrations, winds = readings(200, seed=3, cells=cells)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x' = -y, y' = x
    straight, turned = (
        mapped((positions, concentrations, winds), cells),
        mapped((positions @ turn.T, concentrations, winds @ turn.T), cells),
    )
    for name in ("mean", "variance", "confidence"):
        before = getattr(straight, name).reshape(cells.shape)
        after = getattr(turned, name).reshape(cells.shape)
        np.testing.assert_allclose(after, before.transpose(1, 0, 2)[::-1], rtol=1e-8, atol=1e-9)


def test_moving_the_world_moves_nothing_in_the_map() -> None:
    positions, concentrations, winds = readings(200, seed=4)
    away = np.array([100.0, -40.0, 12.0])
    moved = Cells(TUNNEL.low + away, TUNNEL.high + away, TUNNEL.shape)
    there = mapped((positions + away, concentrations, winds), moved)
    # 100 m away a coordinate is good to 1e-14 m, the exponent to some 1e-12
    np.testing.assert_allclose(there.mean, mapped((positions, concentrations, winds)).mean, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("shrink_to", ["nothing", "average"])
def test_a_constant_concentration_has_a_constant_mean_and_no_variance(shrink_to: str) -> None:
    positions, _, winds = readings(40, seed=5)
    kernel_map = mapped((positions, np.full(40, 37.0), winds), shrink_to=shrink_to)
    reached = kernel_map.weight > 0
    assert 0.2 < reached.mean() < 1
    np.testing.assert_allclose(kernel_map.mean[reached], 37.0, rtol=1e-12)
    np.testing.assert_allclose(kernel_map.variance, 0.0, atol=1e-20)
    np.testing.assert_allclose(kernel_map.mean[~reached], 37.0 if shrink_to == "average" else 0.0, rtol=1e-12)


def test_the_mean_lies_between_the_readings_and_is_linear_in_them() -> None:
    positions, concentrations, winds = readings(300, seed=6)
    kernel_map = mapped((positions, concentrations, winds))
    reached = kernel_map.weight > 0
    assert np.all(kernel_map.mean[reached] >= concentrations.min() * (1 - 1e-12))
    assert np.all(kernel_map.mean <= concentrations.max() * (1 + 1e-12))
    assert np.all(kernel_map.variance >= 0)
    other = mapped((positions, 3 * concentrations + 5, winds))
    np.testing.assert_allclose(other.mean[reached], 3 * kernel_map.mean[reached] + 5, rtol=1e-10)
    np.testing.assert_allclose(other.variance, 9 * kernel_map.variance, rtol=1e-8, atol=1e-8)


def test_confidence_grows_with_the_readings_and_stays_below_one() -> None:
    kernel_map = KernelMap(TUNNEL)
    before = kernel_map.confidence
    np.testing.assert_array_equal(before, 0.0)
    centre = TUNNEL.centres[333]
    for i in range(1, 60):
        kernel_map.add(centre, 1.0, AIR)
        now = kernel_map.confidence
        assert np.all((now >= before) & (now < 1))
        assert now[333] == pytest.approx(1 - math.exp(-i), rel=1e-12)  # (7): a reading at the centre weighs 1
        before = now
    assert before[0] == 0.0  # out of the kernel's reach
    assert kernel_map.measured[333]
    assert not kernel_map.measured[0]


def test_the_scale_of_confidence_is_a_parameter() -> None:
    taken = readings(50, seed=7)
    one, wide = mapped(taken), mapped(taken, confidence_scale=4.0)
    np.testing.assert_allclose(wide.confidence, 1 - (1 - one.confidence) ** 0.25, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(wide.mean, one.mean)


@pytest.mark.parametrize("shrink_to", ["nothing", "average"])
def test_an_empty_map_is_zero(shrink_to: str) -> None:
    kernel_map = KernelMap(TUNNEL, KernelParameters(shrink_to=shrink_to))
    for values in (kernel_map.mean, kernel_map.variance, kernel_map.confidence, kernel_map.weight):
        np.testing.assert_array_equal(values, np.zeros(700))
    assert not kernel_map.measured.any()
    assert kernel_map.n_readings == 0
    assert kernel_map.readings.shape == kernel_map.reading_cells.shape == (0,)


def test_readings_of_zero_and_of_one_cell() -> None:
    positions, _, winds = readings(50, seed=8)
    zero = mapped((positions, np.zeros(50), winds))
    np.testing.assert_array_equal(zero.mean, 0.0)
    np.testing.assert_array_equal(zero.variance, 0.0)
    one = mapped(
        (np.full((3, 3), 0.5), np.array([1.0, 2.0, 6.0]), np.zeros((3, 3))), Cells((0, 0, 0), (1, 1, 1), (1, 1, 1))
    )
    np.testing.assert_allclose(one.mean, [3.0])
    np.testing.assert_allclose(one.variance, [14 / 3])


def test_a_reading_far_outside_is_kept_and_changes_no_cell() -> None:
    kernel_map = KernelMap(TUNNEL)
    kernel_map.add((50, 50, 50), 9.0, AIR)
    np.testing.assert_array_equal(kernel_map.weight, 0.0)
    assert kernel_map.n_readings == 1
    assert kernel_map.reading_cells.tolist() == [699]
    near = KernelMap(TUNNEL)
    near.add((-0.1, 0.1, 0.05), 9.0, AIR)  # in front of the face of cell 0
    assert near.mean[0] == pytest.approx(9.0, rel=1e-12)
    assert 0 < near.confidence[0] < 0.5


def test_the_readings_are_told_and_cannot_be_written() -> None:
    positions, concentrations, winds = readings(600, seed=9)  # more than the first buffer holds
    kernel_map = mapped((positions, concentrations, winds))
    np.testing.assert_array_equal(kernel_map.positions, positions)
    np.testing.assert_array_equal(kernel_map.readings, concentrations)
    assert kernel_map.reading_cells.tolist() == [TUNNEL.nearest(place) for place in positions]
    for values in (kernel_map.positions, kernel_map.readings, kernel_map.weight, kernel_map.mean, kernel_map.variance):
        assert not values.flags.writeable
    kernel_map.clear()
    assert kernel_map.n_readings == 0
    for position, concentration, wind in zip(positions[:9], concentrations[:9], winds[:9], strict=True):
        kernel_map.add(position, concentration, wind)
    anew = mapped((positions[:9], concentrations[:9], winds[:9]))
    np.testing.assert_array_equal(kernel_map.mean, anew.mean)
    np.testing.assert_array_equal(kernel_map.variance, anew.variance)


def test_maps_do_not_change_after_they_were_asked_for() -> None:
    kernel_map = mapped(readings(20, seed=10))
    mean, confidence = kernel_map.mean, kernel_map.confidence
    kept = mean.copy(), confidence.copy()
    kernel_map.add((3, 1, 0.2), 500.0, AIR)
    np.testing.assert_array_equal(mean, kept[0])
    np.testing.assert_array_equal(confidence, kept[1])
    assert not np.array_equal(kernel_map.mean, kept[0])


@pytest.mark.parametrize(
    ("position", "concentration", "wind"),
    [
        ((math.nan, 0, 0), 1.0, AIR),
        ((1, 1, 1), math.inf, AIR),
        ((1, 1, 1), 1.0, (0, math.nan, 0)),
        ((1, 1, 1), 1.0, (1e200, 0, 0)),
        ((1, 1), 1.0, AIR),
        ((1, 1, 1), 1.0, 0.2),
    ],
)
def test_readings_that_are_not_finite_are_refused_and_leave_no_trace(
    position: Any, concentration: float, wind: Any
) -> None:
    kernel_map = mapped(readings(20, seed=11))
    mean = kernel_map.mean.copy()
    with pytest.raises(InputError, match="kernel map: "):
        kernel_map.add(position, concentration, wind)
    assert kernel_map.n_readings == 20
    np.testing.assert_array_equal(kernel_map.mean, mean)


@pytest.mark.parametrize("parameters", [{"width": 0}, {"stretching": -1}, {"cutoff": 0}, {"measured_confidence": 1}])
def test_impossible_kernels_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        KernelParameters(**parameters)


# --- gas and no gas


def test_two_clear_groups_are_told_apart() -> None:
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(10, 1, 60), rng.normal(200, 20, 40)])
    np.testing.assert_array_equal(gaseous(values, 0.0), np.arange(100) >= 60)
    assert gas_threshold(values, 0.0) == pytest.approx((values[:60].mean() + values[60:].mean()) / 2, rel=1e-12)


def test_the_two_means_stand_still() -> None:
    """A further round of 2-means from the split would not change it."""
    values = np.random.default_rng(1).exponential(50, 700)
    gas = gaseous(values, 0.0)
    assert gas_threshold(values, 0.0) == pytest.approx((values[gas].mean() + values[~gas].mean()) / 2, rel=1e-12)


def test_the_split_does_not_depend_on_order_scale_or_offset() -> None:
    values = np.random.default_rng(2).exponential(50, 300)
    order = np.random.default_rng(3).permutation(300)
    np.testing.assert_array_equal(gaseous(values[order], 0.0), gaseous(values, 0.0)[order])
    np.testing.assert_array_equal(gaseous(1e6 * values + 3, 0.0), gaseous(values, 0.0))


def test_nothing_under_the_floor_is_gas() -> None:
    values = np.random.default_rng(4).uniform(0, 4, 700)  # the noise of clean air
    assert gaseous(values, 0.0).any()
    assert not gaseous(values, 5.0).any()
    assert gas_threshold(values, 5.0) == 5.0


@pytest.mark.parametrize(
    ("values", "gas"), [([], []), ([0.0] * 5, [False] * 5), ([9.0] * 3, [True] * 3), ([9.0], [True])]
)
def test_equal_values_and_few_cells_are_judged_by_the_floor(values: list[float], gas: list[bool]) -> None:
    assert gaseous(values, 5.0).tolist() == gas
    assert not gaseous(values, 9.0).any()


def test_two_values_next_to_each_other_give_two_groups() -> None:
    assert gaseous([1.0, np.nextafter(1.0, 2.0)], 0.0).sum() <= 1


def test_cells_that_do_not_count_hold_no_gas_and_do_not_move_the_split() -> None:
    values = np.array([0.0, 1.0, 100.0, 110.0, 1e6])
    among = np.array([True, True, True, True, False])
    assert gaseous(values, 0.0, among).tolist() == [False, False, True, True, False]
    assert not gaseous(values, 0.0, np.zeros(5, bool)).any()


def test_maps_that_cannot_be_split_are_refused() -> None:
    with pytest.raises(InputError, match="gas map"):
        gaseous([1.0, math.nan], 0.0)
    with pytest.raises(InputError, match="gas map"):
        gaseous([1.0, 2.0], 0.0, [True])


# --- the final map


def test_the_final_map_takes_each_cell_from_where_it_is_known() -> None:
    plume = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    mean = np.array([10.0, 20.0, 1.0, 3.0, 99.0])
    measured, gas = np.array([1, 1, 1, 1, 0], bool), np.array([1, 1, 0, 0, 1], bool)
    np.testing.assert_allclose(final_map(plume, mean, measured, gas), [10.0, 20.0, 2.0, 2.0, 5.0])
    np.testing.assert_array_equal(plume, [1, 2, 3, 4, 5])


def test_nothing_measured_leaves_the_plume_and_all_gaseous_the_measured_map() -> None:
    plume, mean = np.arange(4.0), np.full(4, 7.0)
    nowhere, everywhere = np.zeros(4, bool), np.ones(4, bool)
    np.testing.assert_array_equal(final_map(plume, mean, nowhere, everywhere), plume)
    np.testing.assert_array_equal(final_map(plume, mean, everywhere, everywhere), mean)
    np.testing.assert_array_equal(final_map(plume, mean, everywhere, nowhere), mean)
    with pytest.raises(InputError, match="final map"):
        final_map(plume, mean[:3], everywhere, nowhere)
