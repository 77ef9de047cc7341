"""Laws of the filament plume in the open: mass, time mean, steps, rotation, strength, sources, batches, capacity.

Fixed seeds; tolerances are four to five standard errors, as said at each.
"""

from __future__ import annotations

import itertools
import math
import warnings
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from osl_env.air import uniform_air
from osl_env.arena import Arena
from osl_env.geometry import open_air
from osl_env.plumes.base import Scene
from osl_env.plumes.filament import FilamentPlume, diffusion_of
from osl_env.plumes.filament_noise import exp_single, normals

AREA = (100.0, 60.0, 30.0)
SOURCE = (20.0, 30.0, 15.0)
WIND = (1.0, 0.0, 0.0)


def scene(n_envs: int = 1, sources: Any = (SOURCE,), wind: Any = WIND, area: Any = AREA) -> Scene:
    air = uniform_air(n_envs)
    air.mean[:] = wind
    places = np.tile(np.asarray(sources, float), (n_envs, 1, 1))
    strengths = np.ones(places.shape[:2])
    return Scene(places, strengths, air, open_air(), np.array(area), np.zeros((n_envs, 2, 3)))


def run(plume: FilamentPlume, at: Scene, seconds: float, seeds: Any = (7,)) -> Any:
    n_envs, n_sources = at.strengths.shape
    state = plume.allocate(n_envs, n_sources, Arena(size=tuple(at.area)))
    plume.begin(state, at, np.arange(n_envs), np.asarray(seeds))
    for _ in range(round(seconds / plume.step)):
        plume.advance(state, at, np.ones(n_envs, bool))
    return state


def cells(low: Any, high: Any, n: Any) -> tuple[np.ndarray, float]:
    """Centres of the cells of a box, and their volume."""
    axes = [np.linspace(a, b, k, endpoint=False) + (b - a) / k / 2 for a, b, k in zip(low, high, n, strict=True)]
    volume = float(np.prod([(b - a) / k for a, b, k in zip(low, high, n, strict=True)]))
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1), volume


def test_gaden_numbers_of_muc_osl() -> None:
    plume = FilamentPlume()  # 100 ppm, 50 cm, 50 filaments/s, 298 K, 1 atm
    assert plume.moles == pytest.approx(8.05e-3, rel=1e-3)
    assert plume.moles * plume.filament_rate * plume.molar_mass == pytest.approx(18.5, rel=3e-3)  # g/s of ethanol
    by_rate = FilamentPlume(release_rate=plume.moles * 50.0 * 46.07)
    assert by_rate.content == pytest.approx(plume.content, rel=1e-12)
    in_grams = FilamentPlume(release_rate=0.05, gas_unit="g/m^3", filament_rate=20.0)
    assert in_grams.content == pytest.approx(0.0025)
    assert in_grams.moles == pytest.approx(0.0025 / 46.07)
    assert plume.diffusion == pytest.approx(diffusion_of(0.5, 0.5)) == pytest.approx(math.sqrt(0.5))


def test_normals_are_standard_and_independent() -> None:
    z = normals(np.uint64(3), 20_000).astype(np.float64)  # 3.84 M
    n = z.size
    for power, moment in ((1, 0.0), (2, 1.0), (3, 0.0), (4, 3.0), (6, 15.0)):
        spread = math.sqrt((math.prod(range(1, 2 * power, 2)) - moment**2) / n)  # E z^2p - (E z^p)^2
        assert (z**power).mean() == pytest.approx(moment, abs=4.5 * spread), power
    for limit in (0.5, 1.0, 2.0, 3.0, 4.0):
        share = math.erfc(limit / math.sqrt(2.0))
        assert (abs(z) > limit).mean() == pytest.approx(share, abs=4.5 * math.sqrt(share * (1 - share) / n)), limit
    rows = z.reshape(-1, 3, 64)
    pairs = [(rows[:, i], rows[:, j]) for i, j in itertools.combinations(range(3), 2)]
    pairs += [(rows[:, :, :-1], rows[:, :, 1:]), (rows[:-1], rows[1:])]
    pairs += [(z.reshape(-1, 2, 96)[:, 0], z.reshape(-1, 2, 96)[:, 1])]  # the two of one word
    for one, two in pairs:
        assert abs((one * two).mean()) < 4.5 / math.sqrt(one.size)
        assert abs((one**2 * two**2).mean() - 1.0) < 4.5 * math.sqrt(8.0 / one.size)


def test_exponential_of_single_precision() -> None:
    x = np.linspace(-80.0, 0.0, 4001).astype(np.float32)
    values = np.array([exp_single(v) for v in x], dtype=np.float64)
    np.testing.assert_allclose(values, np.exp(x.astype(np.float64)), rtol=3e-7)


@pytest.mark.parametrize(("height", "floor"), [(15.0, "open"), (1.0, "reflect")])
def test_released_mass_is_the_integral_of_concentration(height: float, floor: str) -> None:
    """Without noise the plume stays where the grid is; a grid of half a sigma integrates Gaussians to 1e-4."""
    plume = FilamentPlume(floor=floor, diffusion=0.2, filament_rate=10.0, cut_off=3.0)
    at = scene(sources=[(20.0, 30.0, height)])
    state = run(plume, at, 8.0)
    points, volume = cells((10.0, 20.0, 0.0), (40.0, 40.0, 30.0), (120, 80, 120))
    mass = plume.at(state, at, 0, points).sum() * volume
    assert int(state.live[0]) == 80
    assert mass == pytest.approx(80 * plume.content, rel=2e-3)  # the cut-off is a jump of the size 1e-2 of the peak


def test_time_mean_is_the_steady_advection_diffusion_plume() -> None:
    """C = q / (4 pi D r) exp(-U (r - x) / (2 D)), D = s^2 / 2 (point source; small filaments)."""
    s = 0.6
    d = s**2 / 2
    plume = FilamentPlume(
        sigma=0.1, growth=0.0, diffusion=s, filament_rate=40.0, release_rate=1.0, gas_unit="g/m^3", step=0.25
    )
    n = 64
    at = scene(n)
    state = run(plume, at, 60.0, np.arange(n))
    x, y = (8.0, 16.0, 30.0), (0.0, 1.5)
    offsets = np.array([(a, b, 0.0) for a in x for b in y])
    places = np.tile(np.array(SOURCE) + offsets, (n, 1, 1))
    readings, out = [], np.empty((n, len(offsets)))
    for _ in range(80):
        for _ in range(8):
            plume.advance(state, at, np.ones(n, bool))
        plume.read(state, at, places, np.ones(n, bool), out)
        readings.append(out.copy())
    worlds = np.mean(readings, axis=0)  # (n, n_places)
    r = np.linalg.norm(offsets, axis=1)
    expected = 1.0 / (4 * math.pi * d * r) * np.exp(-(r - offsets[:, 0]) / (2 * d))
    error = worlds.std(axis=0, ddof=1) / math.sqrt(n)
    assert (error < 0.1 * expected).all()
    assert (abs(worlds.mean(axis=0) - expected) < 4.5 * error + 0.03 * expected).all()  # 3 %: the filaments' size


def test_halving_the_step_leaves_mean_and_spread() -> None:
    n = 40
    figures = []
    for step in (1.0, 0.5, 0.125):
        plume = FilamentPlume(step=step, filament_rate=10.0, development=0.0)
        at = scene(n)
        state = run(plume, at, 20.0, np.arange(n))
        places = [plume.filaments(state, e).positions for e in range(n)]
        sigmas = [plume.filaments(state, e).sigmas for e in range(n)]
        means = np.array([p.mean(axis=0) for p in places])
        squares = np.array([((p[:, 1] - SOURCE[1]) ** 2).mean() for p in places])
        assert all(len(p) == 200 for p in places)
        figures.append((means, squares, np.array([(v**2).mean() for v in sigmas])))
    for means, squares, variances in figures:
        assert means[:, 0].mean() - SOURCE[0] == pytest.approx(10.0, abs=4.5 * means[:, 0].std() / math.sqrt(n))
        assert squares.mean() == pytest.approx(0.5 * 10.0, abs=4.5 * squares.std() / math.sqrt(n))  # s^2 * mean age
        assert variances.mean() == pytest.approx(0.25 + 0.005 * 10.0, rel=1e-4)


@pytest.mark.parametrize("turn", [0.4, math.pi / 2, 2.5])
def test_rotating_the_world_rotates_the_field(turn: float) -> None:
    """Exactly, to single precision, without noise."""
    c, s = math.cos(turn), math.sin(turn)
    rotate = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    centre = np.array([30.0, 30.0, 15.0])
    plume = FilamentPlume(diffusion=0.0, filament_rate=4.0)
    points = centre + np.random.default_rng(0).uniform((-12, -3, -3), (8, 8, 3), (400, 3))
    fields = []
    for turned in (np.eye(3), rotate):
        source = centre + turned @ np.array([-10.0, 0.0, 0.0])
        at = scene(sources=[source], wind=turned @ np.array([1.0, 0.3, 0.0]), area=(60.0, 60.0, 30.0))
        fields.append(plume.at(run(plume, at, 15.0), at, 0, centre + (points - centre) @ turned.T))
    assert (fields[0] > 0).mean() > 0.05
    np.testing.assert_allclose(fields[1], fields[0], rtol=2e-3, atol=1e-3)  # a reading at the very cut-off may differ


def test_linear_in_strength_and_in_release_rate() -> None:
    points = np.random.default_rng(1).uniform((18, 25, 10), (40, 35, 20), (300, 3))

    def field(strength: float, rate: float) -> Any:
        plume = FilamentPlume(release_rate=rate)
        at = scene()
        at.strengths[:] = strength
        return plume.at(run(plume, at, 20.0), at, 0, points)

    once = field(1.0, 2.0)
    assert once.max() > 0
    np.testing.assert_allclose(field(3.0, 2.0), 3 * once, rtol=1e-5)
    np.testing.assert_allclose(field(1.0, 5.0), 2.5 * once, rtol=1e-5)
    assert (field(0.0, 2.0) == 0.0).all()


def test_two_sources_are_the_sum_of_each() -> None:
    """Exactly without noise."""
    plume = FilamentPlume(diffusion=0.0)
    points = np.random.default_rng(2).uniform((18, 25, 10), (40, 35, 20), (300, 3))
    sources = [(20.0, 29.0, 15.0), (24.0, 31.0, 14.0)]
    fields = []
    for chosen in (sources[:1], sources[1:], sources):
        at = scene(sources=chosen)
        fields.append(plume.at(run(plume, at, 20.0), at, 0, points))
    np.testing.assert_allclose(fields[2], fields[0] + fields[1], rtol=2e-5, atol=1e-6)


def test_reading_is_the_sum_over_all_filaments() -> None:
    """Blocks and boxes leave nothing out, whatever the order that filaments are kept in."""
    plume = FilamentPlume(filament_rate=30.0, cut_off=4.0)
    at = scene(sources=[(15.0, 30.0, 2.0), (40.0, 20.0, 10.0)])
    state = run(plume, at, 70.0)
    f = plume.filaments(state, 0)
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform((0, 0, 0), AREA, (200, 3)), f.positions[rng.integers(0, len(f.ages), 200)]])
    share = math.erf(4 / math.sqrt(2)) - math.sqrt(2 / math.pi) * 4 * math.exp(-8)
    expected = np.zeros(len(points))
    for mirror in ((1, 1, 1), (1, 1, -1)):
        q = ((points[:, None] - f.positions * mirror) ** 2).sum(-1) / f.sigmas**2
        part = f.contents / (share * (2 * math.pi) ** 1.5 * f.sigmas**3) * np.exp(-q / 2)
        expected += np.where(q <= 16.0, part, 0.0).sum(axis=1)
    np.testing.assert_allclose(plume.at(state, at, 0, points), expected, rtol=2e-3, atol=1e-2)


def test_far_sensor_reads_exactly_zero() -> None:
    plume = FilamentPlume()
    at = scene()
    state = run(plume, at, 30.0)
    assert plume.at(state, at, 0, np.array([5.0, 5.0, 28.0])) == 0.0
    assert plume.at(state, at, 0, np.array([20.0, 30.0, 15.0])) > 0.0


def test_row_of_a_batch_is_a_batch_of_one_and_repeats() -> None:
    plume = FilamentPlume(filament_rate=20.0)
    n = 5
    at = scene(n, sources=[SOURCE, (60.0, 20.0, 3.0)])
    at.air.mean[:] += np.random.default_rng(4).normal(0, 0.3, (n, 3))
    seeds = np.arange(n) + 100
    batch, again = run(plume, at, 60.0, seeds), run(plume, at, 60.0, seeds)
    assert (batch.bodies == again.bodies).all()
    points = np.random.default_rng(5).uniform((0, 0, 0), AREA, (n, 50, 3))
    out = np.empty((n, 50))
    plume.read(batch, at, points, np.ones(n, bool), out)
    for e in range(n):
        alone = scene(1, sources=at.sources[e], wind=at.air.mean[e])
        state = run(plume, alone, 60.0, seeds[e : e + 1])
        assert (state.bodies[0] == batch.bodies[e]).all()
        one = np.empty((1, 50))
        plume.read(state, alone, points[e : e + 1], np.ones(1, bool), one)
        assert (one[0] == out[e]).all()
    assert not (batch.bodies[0] == batch.bodies[1]).all()


def test_worlds_that_are_not_due_stay_and_begin_clears() -> None:
    plume = FilamentPlume()
    at = scene(2)
    state = run(plume, at, 5.0, (1, 2))
    before = state.bodies[1].copy()
    plume.advance(state, at, np.array([True, False]))
    assert (state.bodies[1] == before).all()
    plume.begin(state, at, np.array([0]), np.array([1]))
    assert state.live.tolist() == [0, 250]
    out = np.full((2, 1), -1.0)
    plume.read(state, at, np.tile(SOURCE, (2, 1, 1)), np.array([True, False]), out)
    assert out[0, 0] == 0.0
    assert out[1, 0] == -1.0


def test_release_keeps_its_rate_and_no_wind_works() -> None:
    """0.7 filaments/s at a step of 0.1 s: the fraction is owed; in still air, age alone ends them."""
    plume = FilamentPlume(filament_rate=0.7, step=0.1, max_age=40.0, diffusion=0.1)
    at = scene(wind=(0.0, 0.0, 0.0))
    assert run(plume, at, 20.0).live[0] == 14
    ages = np.sort(plume.filaments(run(plume, at, 20.0), 0).ages)
    np.testing.assert_allclose(np.diff(ages), 1 / 0.7, rtol=1e-4)
    state = run(plume, at, 200.0)
    assert state.live[0] == pytest.approx(28, abs=1)
    assert plume.at(state, at, 0, np.array(SOURCE)) > 0.0


def test_floor_reflects_absorbs_or_is_open() -> None:
    live = {}
    for floor in ("reflect", "absorb", "open"):
        plume = FilamentPlume(floor=floor, rise=-0.5, diffusion=0.2, margin=2.0)
        at = scene(sources=[(20.0, 30.0, 3.0)])
        f = plume.filaments(run(plume, at, 20.0), 0)
        live[floor] = len(f.ages)
        assert (f.positions[:, 2] >= 0).all() == (floor != "open")
    assert live["reflect"] == 1000
    assert live["absorb"] < live["open"] < 800  # they fall 3 m in 6 s, 5 m in 10 s


def test_full_capacity_merges_with_mass_or_drops_the_oldest() -> None:
    at = scene(wind=(0.2, 0.0, 0.0))
    plume = FilamentPlume(capacity=512, when_full="merge", max_age=1e6)
    with pytest.warns(RuntimeWarning, match=r"capacity = 512 is full"):
        state = run(plume, at, 20.0)
    whole = run(FilamentPlume(max_age=1e6, capacity=4096, when_full="merge"), at, 20.0)
    merged, free = plume.filaments(state, 0), plume.filaments(whole, 0)
    assert state.merged[0] > 0
    assert state.dropped[0] == 0
    assert merged.contents.sum() == pytest.approx(1000 * plume.content, rel=1e-4)

    def spread(f: Any) -> float:  # second moment along y of the whole cloud
        return float((f.contents * (f.sigmas**2 + (f.positions[:, 1] - 30.0) ** 2)).sum() / f.contents.sum())

    assert spread(merged) == pytest.approx(spread(free), rel=0.15)  # 1000 filaments that walk on differently
    oldest = FilamentPlume(capacity=512, when_full="oldest", max_age=1e6)
    with pytest.warns(RuntimeWarning):
        state = run(oldest, at, 20.0)
    ages = oldest.filaments(state, 0).ages
    assert state.dropped[0] == 1000 - len(ages)
    assert ages.max() < 512 / 50 + 0.6


def test_capacity_that_may_not_suffice_is_refused_at_load() -> None:
    arena = Arena()
    FilamentPlume().check(arena, 3)
    with pytest.raises(ValueError, match=r"capacity = 5000: 1 source\(s\) of 50 filaments/s within max_age = 300 s"):
        FilamentPlume(capacity=5000).check(arena, 1)
    FilamentPlume(capacity=5000, when_full="merge").check(arena, 1)
    with pytest.raises(ValueError, match=r"capacity = 20: .*two ticks"):
        FilamentPlume(capacity=20, when_full="oldest").check(arena, 1)
    with pytest.raises(ValueError, match=r"max_age = 1e\+09"):
        FilamentPlume(max_age=1e9).check(arena, 1)
    with pytest.raises(ValidationError, match="max_age = inf: needs a capacity"):
        FilamentPlume(max_age=math.inf)
    with pytest.raises(ValidationError, match="one of the two"):
        FilamentPlume(release_rate=1.0, centre_concentration=5.0)


def test_refused_capacity_is_never_reached() -> None:
    """The default capacity, with nothing that ends a filament but age."""
    plume = FilamentPlume(max_age=20.0, diffusion=0.05, filament_rate=37.3)
    at = scene(wind=(0.0, 0.0, 0.0), sources=[SOURCE, (50.0, 30.0, 10.0)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state = run(plume, at, 90.0)
    assert state.dropped[0] == 0
    assert state.live[0] == pytest.approx(2 * 37.3 * 20, abs=4)


def test_memory_of_a_filament() -> None:
    state = FilamentPlume().allocate(1, 1, Arena())
    assert sum(array.nbytes for array in state) / state.bodies.shape[2] < 25
