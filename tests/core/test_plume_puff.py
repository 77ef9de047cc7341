"""Gaussian puffs: eq 2 written out, mass, the steady limit, time, wind that turns, symmetries, batches."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from osl_env.air import Air, uniform_air
from osl_env.arena import Arena
from osl_env.geometry import open_air
from osl_env.parameters import FloatArray
from osl_env.plumes.base import Scene
from osl_env.plumes.puff import GaussianPuffPlume, puff_series
from osl_env.plumes.puff_kernels import DISTANCE, MASS, X, Y, Z

LAWS: Any = [
    {"kind": "briggs_open_country", "stability": "A"},
    {"kind": "briggs_urban", "stability": "D"},
    {"kind": "pasquill_gifford", "stability": "B"},
    {"kind": "fixed", "sigma_y": 0.8, "sigma_z": 0.6, "diffusivity_y": 0.3, "diffusivity_z": 0.1},
]
SOURCE = ((10.0, 15.0, 5.0),)


class Case:
    """A batch of worlds of one plume, in uniform air unless another is given."""

    def __init__(
        self,
        plume: GaussianPuffPlume,
        sources: Any = (SOURCE,),
        winds: Any = ((2.0, 0.0, 0.0),),
        strengths: Any = None,
        air: Air | None = None,
    ) -> None:
        origins = np.array(sources, np.float64)
        self.plume, self.n_envs = plume, len(origins)
        self.air = air or uniform_air(self.n_envs)
        self.air.mean[:] = winds
        shares = np.ones(origins.shape[:2]) if strengths is None else np.array(strengths, np.float64)
        self.scene = Scene(
            origins, shares, self.air, open_air(), np.array([30.0, 30.0, 10.0]), np.zeros((self.n_envs, 1, 3))
        )
        self.state = plume.allocate(self.n_envs, origins.shape[1])
        rows = np.arange(self.n_envs)
        plume.begin(self.state, self.scene, rows, rows)

    def ticks(self, n: int, due: Any = None) -> Case:
        mask = np.ones(self.n_envs, np.bool_) if due is None else np.array(due)
        for _ in range(n):
            self.plume.advance(self.state, self.scene, mask)
        return self

    def read(self, positions: FloatArray) -> FloatArray:
        out = np.full(positions.shape[:2], np.nan)
        self.plume.read(self.state, self.scene, positions, np.ones(self.n_envs, np.bool_), out)
        return out

    def at(self, points: Any, env: int = 0) -> FloatArray:
        return self.plume.at(self.state, self.scene, env, np.asarray(points, np.float64))

    def held(self, env: int = 0) -> FloatArray:
        """The puffs that there are, (8, n)."""
        puffs = self.state.puffs[env]
        return puffs[:, puffs[MASS] > 0]


def points(n: int = 300, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).uniform((8, 8, 0), (30, 22, 10), (n, 3))


def mass_in_the_air(case: Case, low: Any, high: Any, cells: Any) -> float:
    """The integral of the concentration over a box: midpoint rule, spectrally exact for Gaussians."""
    sides = [(np.arange(n) + 0.5) * (b - a) / n + a for a, b, n in zip(low, high, cells, strict=True)]
    grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    volume = np.prod((np.array(high) - low) / np.array(cells))
    return float(case.at(grid).sum() * volume)


def test_equation_2_written_out() -> None:
    """A plume of the paper, 25 s old, against eqs 1 to 3 term by term (no cut-off to speak of)."""
    plume = GaussianPuffPlume(ground=-1.0, cut_off=30.0)
    expected = np.zeros(300)
    for age in np.arange(51) * 0.5:
        x, y, z = (points() - (10.0 + 2.0 * age, 15.0, 5.0 + 0.15 * age)).T
        sy = max(0.22 * 2 * age / np.sqrt(1 + 1e-4 * 2 * age), 0.5)
        sz = max(0.20 * 2 * age, 0.2)
        image = points()[:, 2] + 1.0 + (5.0 + 0.15 * age) + 1.0
        vertical = np.exp(-(z**2) / (2 * sz**2)) + np.exp(-(image**2) / (2 * sz**2))
        expected += 66.7 * 0.5 / ((2 * np.pi) ** 1.5 * sy**2 * sz) * np.exp(-(x**2 + y**2) / (2 * sy**2)) * vertical
    np.testing.assert_allclose(Case(plume).at(points()), expected, rtol=1e-10, atol=1e-30)


@pytest.mark.parametrize("dispersion", LAWS)
@pytest.mark.parametrize(("ground", "rise"), [(None, 0.15), (0.0, 0.0), (-0.5, -0.4)])
def test_released_mass_is_the_integral_of_the_concentration(dispersion: Any, ground: Any, rise: float) -> None:
    """With and without reflection, for every law; 7e-8 lies beyond the cut-off, at most 3e-6 between the cells."""
    plume = GaussianPuffPlume(
        release_rate=3.0, interval=1.0, step=0.5, max_age=4.0, ground=ground, rise=rise, dispersion=dispersion
    )
    case = Case(plume, sources=[[(0.0, 0.0, 1.0), (1.0, 2.0, 0.3)]], strengths=[[1.0, 0.5]]).ticks(3)
    bottom = -12.0 if ground is None else ground
    mass = mass_in_the_air(case, (-10.0, -14.0, bottom), (24.0, 16.0, bottom + 25.0), (85, 75, 125))
    # ages 0.5, 1.5, 2.5 and 3.5 s: 4 puffs a source
    assert case.held().shape[1] == 8
    assert mass == pytest.approx(4 * 3.0 * 1.5, rel=5e-6)


def test_without_wind_mass_is_kept_and_a_puff_still_spreads() -> None:
    plume = GaussianPuffPlume(release_rate=2.0, interval=1.0, step=1.0, max_age=10.0, calm_speed=0.4, rise=0.0)
    case = Case(plume, winds=[(0.0, 0.0, 0.0)])
    mass = mass_in_the_air(case, (2.0, 7.0, 0.0), (18.0, 23.0, 10.0), (50, 50, 50))
    assert mass == pytest.approx(22.0, rel=5e-6)
    np.testing.assert_allclose(np.sort(case.held()[DISTANCE]), 0.4 * np.arange(11), atol=1e-12)


@pytest.mark.parametrize("dispersion", LAWS[:3])
def test_dense_puffs_are_the_gaussian_plume(dispersion: Any) -> None:
    """Q / (2 pi u sy sz) exp(..) with reflection, on the axis and beside it, where sigma changes little over a puff."""
    plume = GaussianPuffPlume(
        interval=0.25, step=0.25, max_age=600.0, ground=0.0, rise=0.0, dispersion=dispersion, release_rate=5.0
    )
    case = Case(plume, sources=[[(0.0, 0.0, 4.0)]], winds=[(2.0, 0.0, 0.0)])
    x = 400.0
    sy, sz = plume.dispersion.sigmas(x)
    y, z = np.array([0.0, 0.7, -1.3]) * sy, np.array([4.0, 1.0, 9.0])
    vertical = np.exp(-((z - 4.0) ** 2) / (2 * sz**2)) + np.exp(-((z + 4.0) ** 2) / (2 * sz**2))
    steady = 5.0 / (2 * np.pi * 2.0 * sy * sz) * np.exp(-(y**2) / (2 * sy**2)) * vertical
    # puffs of different sizes meet at x: a correction of the order (sy / x)^2, 5 % for the widest law here
    tolerance = 3 * (float(sy) / x) ** 2 + 1e-3
    np.testing.assert_allclose(case.at(np.stack([np.full(3, x), y, z], -1)), steady, rtol=tolerance)


def test_constant_sigmas_make_the_gaussian_plume_exactly() -> None:
    plume = GaussianPuffPlume(
        interval=0.1, step=0.1, max_age=40.0, rise=0.0, dispersion={"kind": "fixed", "sigma_y": 0.9, "sigma_z": 0.4}
    )
    places = np.array([[20.0, 0.0, 0.0], [30.0, 1.0, -0.5], [45.1, -2.0, 0.3]])
    case = Case(plume, sources=[[(0.0, 0.0, 0.0)]])
    _, y, z = places.T
    steady = 66.7 / (2 * np.pi * 2.0 * 0.9 * 0.4) * np.exp(-(y**2) / 1.62 - z**2 / 0.32)
    np.testing.assert_allclose(case.at(places), steady, rtol=1e-6)


@pytest.mark.parametrize("wind", [(2.0, 0.5, 0.0), (0.0, 0.0, 0.0)])
def test_a_steady_start_is_what_developing_gives(wind: Any) -> None:
    long = {"max_age": 10.0, "ground": 0.0}
    steady = Case(GaussianPuffPlume(**long), winds=[wind])
    developed = Case(GaussianPuffPlume(**long, steady_start=False, development=10.0), winds=[wind])
    assert developed.plume.lead_time == 10.0
    assert developed.held().shape[1] == 1
    developed.ticks(200)
    np.testing.assert_allclose(developed.at(points()), steady.at(points()), rtol=1e-9, atol=1e-30)
    np.testing.assert_allclose(steady.ticks(10).at(points()), developed.at(points()), rtol=1e-9, atol=1e-30)


def test_the_step_changes_nothing_but_when_a_reading_is_taken() -> None:
    """The same readings at the same times with step = interval / 10, interval and 2 intervals, in uniform wind."""
    readings = [
        Case(GaussianPuffPlume(interval=0.5, step=step, max_age=9.7)).ticks(round(4.0 / step)).at(points())
        for step in (0.05, 0.5, 1.0)
    ]
    np.testing.assert_allclose(readings[1], readings[0], rtol=1e-9, atol=1e-30)
    np.testing.assert_allclose(readings[2], readings[0], rtol=1e-9, atol=1e-30)


def test_halving_the_interval_leaves_the_mean() -> None:
    """Time means over whole intervals at receptors downwind, where a puff is wider than the gap between two."""
    means = []
    for interval in (0.5, 0.25):
        plume = GaussianPuffPlume(interval=interval, step=0.05, max_age=25.0, ground=-1.0)
        winds = np.tile([2.0, 0.0, 0.0], (10, 1))
        means.append(puff_series(plume, SOURCE, winds, [(20, 15, 5.5), (25, 16, 6), (30, 12, 3)]).mean(axis=0))
    # the error of the trapezium rule over Gaussians of sigma = 2 m, 1 m apart, is below 1e-8; ages end within 25 s
    np.testing.assert_allclose(means[1], means[0], rtol=1e-4)


def test_ages_are_exact_after_many_ticks() -> None:
    plume = GaussianPuffPlume(interval=0.1, step=0.1, max_age=1.0, rise=0.0)
    case = Case(plume, winds=[(1.0, 0.0, 0.0)]).ticks(20_000)
    np.testing.assert_allclose(np.sort(case.held()[X]) - 10.0, 0.1 * np.arange(11), atol=1e-9)


@pytest.mark.parametrize(("step", "interval"), [(0.05, 0.5), (1.0, 0.25), (0.5, 0.5), (2.0, 0.1), (0.1, 0.3)])
def test_the_ring_is_never_full(step: float, interval: float) -> None:
    """Every puff lives from its release to `max_age`, whatever the step."""
    plume = GaussianPuffPlume(step=step, interval=interval, max_age=2.35, steady_start=False)
    case = Case(plume, sources=[[(0.0, 0, 0), (5.0, 5, 5)]])
    for n in range(1, 60):
        case.ticks(1)
        time = n * step
        releases = np.arange(np.floor(time / interval + 1e-9) + 1) * interval
        alive = np.sort(time - releases[time - releases <= 2.35 + 1e-9])
        np.testing.assert_allclose(np.sort(case.held()[DISTANCE]), np.repeat(2.0 * alive, 2), atol=1e-9)


def test_a_track_follows_the_integral_of_the_wind() -> None:
    """In wind that turns, every puff is where the wind since its release has carried it, and has travelled its path."""
    plume = GaussianPuffPlume(interval=0.5, step=0.1, max_age=20.0, steady_start=False)
    angle = 0.02 * np.arange(150)
    winds = np.stack([1.5 * np.cos(angle), 1.5 * np.sin(angle), np.zeros(150)], -1)
    case = Case(plume)
    for wind in winds:
        case.air.mean[0] = wind
        case.ticks(1)
    puffs = case.held()
    order = np.argsort(puffs[DISTANCE])
    for k, puff in zip(order, range(31), strict=True):  # the youngest first
        ticks = 5 * puff
        moved = 0.1 * winds[150 - ticks :].sum(axis=0) if ticks else np.zeros(3)
        np.testing.assert_allclose(puffs[:3, k], SOURCE[0] + moved + [0, 0, 0.015 * ticks], atol=1e-9)
        assert puffs[DISTANCE, k] == pytest.approx(0.15 * ticks, abs=1e-9)


def test_puffs_go_round_a_vortex_of_the_air() -> None:
    """In a field of wind that turns about the z axis (solid rotation), a puff stays on its circle: second order."""
    n, spacing = 21, 2.0
    centres = (np.arange(n) - 10) * spacing
    x, y = np.meshgrid(centres, centres, indexing="ij")
    field = np.zeros((1, n, n, 1, 3), np.float32)
    field[0, :, :, 0, 0], field[0, :, :, 0, 1] = -0.2 * y, 0.2 * x
    air = Air(
        np.zeros((1, 3)),
        field,
        np.zeros((1, 2), np.int64),
        np.zeros(1),
        np.array([-20.0, -20.0, 0.0]),
        np.array([spacing, spacing, 1.0]),
    )
    plume = GaussianPuffPlume(interval=0.5, step=0.05, max_age=30.0, rise=0.0)
    puffs = Case(plume, sources=[[(8.0, 0.0, 1.0)]], winds=[(0.0, 0.0, 0.0)], air=air).held()
    age = puffs[DISTANCE] / 1.6
    np.testing.assert_allclose(np.hypot(puffs[X], puffs[Y]), 8.0, rtol=1e-5)
    np.testing.assert_allclose(np.sort(age), 0.5 * np.arange(61), atol=1e-3)
    np.testing.assert_allclose(puffs[X], 8.0 * np.cos(0.2 * age), atol=1e-2)


def test_a_heavy_puff_stays_on_the_ground() -> None:
    plume = GaussianPuffPlume(rise=-1.0, ground=0.0, max_age=10.0)
    case = Case(plume)
    assert case.held()[Z].min() == 0.0
    assert np.all(case.at(points() * [1, 1, -1] - [0, 0, 0.1]) == 0.0)  # no gas in the ground


@pytest.mark.parametrize("angle", [0.3, np.pi / 2, 2.0, 5.1])
def test_turning_the_world_turns_the_field(angle: float) -> None:
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    wind, source = np.array([1.2, -0.5, 0.1]), np.array(SOURCE)
    plume = GaussianPuffPlume(ground=-1.0)
    turned = Case(plume, sources=[source @ turn.T], winds=[turn @ wind]).at(points() @ turn.T)
    np.testing.assert_allclose(turned, Case(plume, winds=[wind]).at(points()), rtol=1e-8, atol=1e-9)


def test_sources_add_and_the_field_is_linear_in_the_rate() -> None:
    sources, strengths = np.array([[10.0, 15, 5], [12, 10, 2], [9, 20, 8]]), np.array([1.0, 0.4, 3.0])
    plume = GaussianPuffPlume(ground=0.0)
    together = Case(plume, sources=[sources], strengths=[strengths]).ticks(7).at(points())
    apart = [
        Case(plume, sources=[sources[k : k + 1]], strengths=[strengths[k : k + 1]]).ticks(7).at(points())
        for k in range(3)
    ]
    np.testing.assert_allclose(together, sum(apart), rtol=1e-12)
    double = GaussianPuffPlume(ground=0.0, release_rate=2 * 66.7)
    np.testing.assert_allclose(
        Case(double, sources=[sources], strengths=[strengths]).ticks(7).at(points()), 2 * together, rtol=1e-12
    )


def test_a_far_sensor_reads_exactly_zero() -> None:
    case = Case(GaussianPuffPlume())
    far = np.array([[[-50.0, 15.0, 5.0], [10.0, 90.0, 5.0], [150.0, 15.0, 5.0], [1e6, 0.0, 0.0]]])
    assert np.array_equal(case.read(far), np.zeros((1, 4)))
    assert np.array_equal(case.at(far), np.zeros((1, 4)))


def test_the_cutoff_leaves_out_what_it_says() -> None:
    whole, cut = Case(GaussianPuffPlume(cut_off=30.0)).at(points()), Case(GaussianPuffPlume(cut_off=6.0)).at(points())
    peak = 51 * 33.35 / ((2 * np.pi) ** 1.5 * 0.5**2 * 0.2)  # of 51 puffs, each no denser than the youngest
    assert np.all(cut <= whole)
    assert np.max(whole - cut) < np.exp(-18.0) * peak


def test_a_row_of_a_batch_is_a_batch_of_one() -> None:
    """Bit for bit, also where other worlds are due at other times; and `at` is the same sum as `read`."""
    rng = np.random.default_rng(3)
    n = 9
    sources, strengths = rng.uniform(5, 15, (n, 2, 3)), rng.uniform(0.5, 2, (n, 2))
    winds = rng.normal(size=(n, 3)) * [2, 2, 0.1]
    winds[4] = 0.0
    positions = sources[:, :1] + rng.normal(size=(n, 5, 3)) * [4, 4, 1]
    plume = GaussianPuffPlume(ground=0.0, max_age=12.3)
    batch = Case(plume, sources, winds, strengths)
    for tick in range(12):
        batch.ticks(1, due=(np.arange(n) + tick) % 3 > 0)
    readings = batch.read(positions)
    for e in range(n):
        alone = Case(plume, sources[e : e + 1], winds[e : e + 1], strengths[e : e + 1])
        alone.ticks(sum((e + tick) % 3 > 0 for tick in range(12)))
        assert np.array_equal(alone.read(positions[e : e + 1])[0], readings[e])
        np.testing.assert_allclose(batch.at(positions[e], env=e), readings[e], rtol=1e-12)
    assert np.all(readings.max(axis=1) > 0)


def test_only_the_worlds_that_are_due_are_read_and_begun() -> None:
    plume = GaussianPuffPlume()
    case = Case(plume, [SOURCE] * 3, [(2.0, 0.0, 0.0)] * 3).ticks(5)
    out = np.full((3, 1), -1.0)
    plume.read(case.state, case.scene, np.full((3, 1, 3), 15.0), np.array([True, False, True]), out)
    assert out[1, 0] == -1.0
    before = case.state.puffs.copy()
    plume.begin(case.state, case.scene, np.array([1]), np.array([7]))
    assert np.array_equal(case.state.puffs[[0, 2]], before[[0, 2]])
    assert case.state.ticks.tolist() == [5, 0, 5]


def test_readings_at_strided_positions() -> None:
    case = Case(GaussianPuffPlume())
    wide = np.zeros((1, 6, 5))
    wide[0, :, :3] = points(6)
    assert np.array_equal(case.read(wide[..., :3]), case.read(points(6)[None]))


def test_the_series_is_what_the_model_reads() -> None:
    """Two sources and turning wind: `puff_series` against ticks and readings, one by one."""
    plume = GaussianPuffPlume(ground=0.0, interval=1.0, step=0.5, max_age=20.0, dispersion={"stability": "C"})
    sources, strengths = np.array([[10.0, 15, 5], [14, 12, 2]]), np.array([1.0, 0.3])
    angle = 0.05 * np.arange(60)
    winds = np.stack([1.5 * np.cos(angle), 1.5 * np.sin(angle), np.zeros(60)], -1)
    series = puff_series(plume, sources, winds, points(40), strengths)
    case = Case(plume, [sources], winds[:1], [strengths])
    for n in range(60):
        case.air.mean[0] = winds[n]
        np.testing.assert_allclose(series[n], case.ticks(1).read(points(40)[None])[0], rtol=1e-12)
    assert series.max() > 0.1


def test_a_series_of_nothing() -> None:
    plume = GaussianPuffPlume()
    assert puff_series(plume, np.empty((0, 3)), np.zeros((4, 3)), points(5)).tolist() == [[0.0] * 5] * 4
    assert puff_series(plume, SOURCE, np.empty((0, 3)), points(5)).shape == (0, 5)
    assert puff_series(plume, SOURCE, np.zeros((4, 3)), np.empty((0, 3))).shape == (4, 0)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((SOURCE, np.zeros((4, 2)), points(5)), "winds"),
        ((SOURCE, np.full((4, 3), np.nan), points(5)), "winds"),
        ((SOURCE[0], np.zeros((4, 3)), points(5)), "sources"),
        ((SOURCE, np.zeros((4, 3)), points(5)[0]), "receptors"),
        ((SOURCE, np.zeros((4, 3)), points(5), [1.0, 2.0]), "strengths"),
    ],
)
def test_a_series_of_other_shapes_is_refused(arguments: Any, named: str) -> None:
    with pytest.raises(ValueError, match=named):
        puff_series(GaussianPuffPlume(), *arguments)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"step": 0.3, "interval": 0.5}, "must divide interval"),
        ({"interval": 1e-3, "step": 1e-3, "max_age": 1e6}, "max_age"),
        ({"ground": 1.0}, "ground"),
        ({"cut_off": 1.0}, "cut_off"),
        ({"dispersion": {"stability": "Z"}}, "stability"),
        ({"dispersion": {"kind": "none"}}, "dispersion"),
        ({"max_age": -1.0}, "max_age"),
        ({"colour": 1.0}, "colour"),
    ],
)
def test_bad_parameters_are_refused(values: Any, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        GaussianPuffPlume(**values)


def test_too_many_puffs_for_many_sources_are_refused() -> None:
    plume = GaussianPuffPlume(interval=1e-3, step=1e-3, max_age=500.0)
    plume.check(Arena(), 1)
    with pytest.raises(ValueError, match="max_age = 500"):
        plume.check(Arena(), 64)
