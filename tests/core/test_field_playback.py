"""Winds and gas played back from fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from osl_env.air import local_winds, uniform_air
from osl_env.arena import Arena
from osl_env.errors import InputError
from osl_env.fields import Field, load_field, save_field
from osl_env.geometry import SOLID, open_air
from osl_env.parameters import FloatArray
from osl_env.plumes.base import Scene
from osl_env.plumes.field import FieldPlume
from osl_env.winds.field import FieldWind

ARENA = Arena(size=(3.0, 2.0, 1.0))
SHAPE, PERIOD = (6, 4, 2), 4.0


def saved(folder: Path, name: str = "a.npz", seed: int = 0, n_t: int = 8, **changes: Any) -> str:
    """A random field that covers the arena, at `folder` / `name`."""
    rng = np.random.default_rng(seed)
    wind = rng.normal(0.3, 1.0, (n_t, *SHAPE, 3)).astype(np.float32)
    gas = rng.gamma(1.0, 5.0, (n_t, *SHAPE)).astype(np.float32)
    content: dict[str, Any] = {"wind": wind, "concentration": gas, "period": PERIOD if n_t > 1 else 0.0} | changes
    save_field(Field(0.5 * np.arange(n_t), [0.25] * 3, [0.5] * 3, **content), folder / name, wind_step=0, mantissa=23)
    return str(folder / name)


def points(n_envs: int, n: int = 5, seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).uniform(0, 1, (n_envs, n, 3)) * ARENA.size


def scene(n_envs: int, n_sources: int = 1, strengths: FloatArray | None = None) -> Scene:
    given = np.ones((n_envs, n_sources)) if strengths is None else strengths
    return Scene(
        np.zeros((n_envs, n_sources, 3)), given, uniform_air(n_envs), open_air(), np.array(ARENA.size), points(n_envs)
    )


def blown(wind: FieldWind, seeds: list[int], clocks: list[float], places: FloatArray) -> FloatArray:
    """The wind at `places` of the worlds with `seeds`, each at its own clock."""
    state = wind.allocate(len(seeds), ARENA)
    numbers = np.array(seeds)
    wind.begin(state, np.arange(len(seeds)), numbers, 0.0)
    wind.advance(state, np.ones(len(seeds), np.bool_), np.array(clocks), wind.step)
    out = np.empty_like(places)
    local_winds(state.air, places, out)
    return out


def smelt(plume: FieldPlume, seeds: list[int], ticks: list[int], places: FloatArray, **options: Any) -> FloatArray:
    """The gas at `places` of the worlds with `seeds`, each after its own number of ticks."""
    within = scene(len(seeds), **options)
    state = plume.allocate(len(seeds), within.strengths.shape[1], ARENA)
    plume.begin(state, within, np.arange(len(seeds)), np.array(seeds))
    for tick in range(max(ticks)):
        plume.advance(state, within, np.array(ticks) > tick)
    out = np.full(places.shape[:2], np.nan)
    plume.read(state, within, places, np.ones(len(seeds), np.bool_), out)
    return out


def test_the_wind_is_the_field_at_the_clock_of_each_world(tmp_path: Path) -> None:
    name = saved(tmp_path)
    wind, places, clocks = FieldWind(field=name), points(3), [0.0, 1.37, 9.9]
    air = blown(wind, [0, 1, 2], clocks, places)
    for e, clock in enumerate(clocks):
        expected = load_field(name).at("wind", places[e], clock)
        np.testing.assert_allclose(air[e], expected, rtol=1e-9, atol=1e-12)


def test_the_gas_is_the_field_at_the_clock_of_each_world(tmp_path: Path) -> None:
    solid: NDArray[np.uint8] = np.zeros(SHAPE, np.uint8)
    solid[2, 1] = SOLID
    name = saved(tmp_path, solid=solid)
    plume, places, ticks = FieldPlume(fields=(name,), step=0.25), points(3, 40), [0, 5, 39]
    gas = smelt(plume, [0, 1, 2], ticks, places)
    for e, n in enumerate(ticks):
        np.testing.assert_allclose(gas[e], load_field(name).at("concentration", places[e], 0.25 * n), rtol=1e-9)


def test_a_world_is_the_same_in_a_batch_and_alone(tmp_path: Path) -> None:
    name = saved(tmp_path)
    wind, plume = FieldWind(field=name, random_start=True), FieldPlume(fields=(name,), random_start=True)
    places, seeds, ticks = points(6), [3, 1, 4, 1, 5, 9], [0, 7, 7, 22, 3, 1]
    air, gas = blown(wind, seeds, [0.1 * n for n in ticks], places), smelt(plume, seeds, ticks, places)
    for e in range(6):
        one = slice(e, e + 1)
        assert np.array_equal(blown(wind, seeds[one], [0.1 * ticks[e]], places[one]), air[one])
        assert np.array_equal(smelt(plume, seeds[one], ticks[one], places[one]), gas[one])


def test_worlds_that_are_not_due_and_not_begun_are_left(tmp_path: Path) -> None:
    name = saved(tmp_path)
    wind, plume, within = FieldWind(field=name), FieldPlume(fields=(name,)), scene(3)
    state, played = wind.allocate(3, ARENA), plume.allocate(3, 1, ARENA)
    everyone, due = np.arange(3), np.array([True, False, True])
    wind.begin(state, everyone, everyone, 0.0)
    plume.begin(played, within, everyone, everyone)
    for _ in range(8):
        plume.advance(played, within, np.ones(3, np.bool_))
    wind.advance(state, np.ones(3, np.bool_), np.full(3, 0.8), 0.1)
    kept = state.air.frame[1].copy(), state.air.blend[1], played[0].frame[1].copy(), played[0].blend[1]
    wind.advance(state, due, np.full(3, 2.2), 0.1)
    plume.advance(played, within, due)
    wind.begin(state, np.array([0]), np.array([7]), 0.0)
    plume.begin(played, within, np.array([0]), np.array([7]))
    now = state.air.frame[1], state.air.blend[1], played[0].frame[1], played[0].blend[1]
    assert all(np.array_equal(a, b) for a, b in zip(kept, now, strict=True))
    assert played[0].ticks.tolist() == [0, 8, 9]
    out = np.full((3, 5), -1.0)
    plume.read(played, within, points(3), due, out)
    assert np.all(out[1] == -1)
    assert np.all(out[[0, 2]] > 0)


def test_a_loop_has_no_seam_and_without_one_the_last_frame_holds(tmp_path: Path) -> None:
    name = saved(tmp_path)
    places = points(2)
    places[1] = places[0]
    for clock in (0.3, 2.1, 3.9):
        first, later = blown(FieldWind(field=name), [0, 0], [clock, clock + 3 * PERIOD], places)
        np.testing.assert_allclose(first, later, atol=1e-6)
    before, after = blown(FieldWind(field=name), [0, 0], [PERIOD - 1e-7, PERIOD + 1e-7], places)
    np.testing.assert_allclose(before, after, atol=1e-5)
    held = blown(FieldWind(field=name, loop=False), [0, 0], [3.5, 99.0], places)
    assert np.array_equal(held[0], held[1])


def test_a_single_frame_is_steady(tmp_path: Path) -> None:
    name = saved(tmp_path, n_t=1)
    wind, plume = FieldWind(field=name), FieldPlume(fields=(name,))
    assert not wind.changes
    assert plume.tick is None
    places = points(2)
    places[1] = places[0]
    first, later = blown(wind, [0, 1], [0.0, 123.4], places)
    assert np.array_equal(first, later)
    assert FieldWind(field=saved(tmp_path, "b.npz")).changes
    assert FieldPlume(fields=(str(tmp_path / "b.npz"),), step=0.2).tick == 0.2


def test_wind_and_gas_of_a_case_begin_at_the_same_random_time(tmp_path: Path) -> None:
    name = saved(tmp_path)
    wind, plume = FieldWind(field=name, random_start=True), FieldPlume(fields=(name,), random_start=True)
    seeds = np.arange(400)
    state, played = wind.allocate(400, ARENA), plume.allocate(400, 1, ARENA)
    wind.begin(state, seeds, seeds, 0.0)
    plume.begin(played, scene(400), seeds, seeds)
    starts = state.memory[:, 0]
    assert np.array_equal(starts, played[0].starts)
    assert np.array_equal(state.air.frame, played[0].frame)
    assert np.array_equal(state.air.blend, played[0].blend)
    assert np.all((starts >= 0) & (starts < PERIOD))
    # uniform in the period: mean PERIOD / 2, standard error PERIOD / sqrt(12 n); 4 of them
    assert abs(starts.mean() - PERIOD / 2) < 4 * PERIOD / np.sqrt(12 * 400)


def test_an_earlier_begin_is_at_the_same_air_later(tmp_path: Path) -> None:
    """A plume that develops before the episode does not shift the wind."""
    wind = FieldWind(field=saved(tmp_path), random_start=True)
    states = [wind.allocate(1, ARENA) for _ in range(2)]
    for state, start in zip(states, (0.0, -7.3), strict=True):
        wind.begin(state, np.arange(1), np.array([5]), start)
        wind.advance(state, np.ones(1, np.bool_), np.array([0.6]), 0.1)
    assert np.array_equal(states[0].air.frame, states[1].air.frame)
    assert states[0].air.blend == pytest.approx(states[1].air.blend)


def test_a_faster_flow_is_similar(tmp_path: Path) -> None:
    name = saved(tmp_path)
    places = points(1)
    slow, fast = FieldWind(field=name), FieldWind(field=name, speed_factor=2.0)
    np.testing.assert_allclose(
        blown(fast, [0], [0.7], places), 2 * blown(slow, [0], [1.4], places), rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(fast.draw(np.arange(3)), 2 * slow.draw(np.arange(3)))
    gas = [smelt(FieldPlume(fields=(name,), speed_factor=k), [0], [n], places) for k, n in ((1.0, 14), (2.0, 7))]
    np.testing.assert_allclose(gas[1], gas[0] / 2, rtol=1e-6)


def test_the_mean_wind_is_drawn_for_all_seeds(tmp_path: Path) -> None:
    name = saved(tmp_path)
    drawn = FieldWind(field=name).draw(np.array([5, 2**62, 0]))
    assert np.array_equal(drawn, np.tile(load_field(name).mean_wind, (3, 1)))
    field = load_field(name)
    assert field.wind is not None
    np.testing.assert_allclose(drawn[0], field.wind.mean(axis=(0, 1, 2, 3)), rtol=1e-4)


def test_an_offset_moves_the_field(tmp_path: Path) -> None:
    name, moved = saved(tmp_path), saved(tmp_path, "moved.npz")
    field = load_field(moved)
    far = Field(field.times, field.origin + np.array([10.0, -5.0, 0.0]), field.spacing, field.wind, period=PERIOD)
    save_field(far, tmp_path / "far.npz", wind_step=0)
    places = points(1)
    near = blown(FieldWind(field=name), [0], [1.0], places)
    back = blown(FieldWind(field=str(tmp_path / "far.npz"), offset=(-10.0, 5.0, 0.0)), [0], [1.0], places)
    np.testing.assert_allclose(back, near, rtol=1e-9, atol=1e-9)


def test_worlds_and_batches_share_one_grid(tmp_path: Path) -> None:
    name = saved(tmp_path)
    wind, plume = FieldWind(field=name), FieldPlume(fields=(name,))
    grids = [wind.allocate(n, ARENA).air.grid for n in (1, 1000)]
    assert np.shares_memory(*grids)
    gas = [plume.allocate(n, 1, ARENA)[0].grid for n in (1, 1000)]
    assert np.shares_memory(*gas)
    faster = FieldWind(field=name, speed_factor=2.0)
    assert np.shares_memory(faster.allocate(1, ARENA).air.grid, faster.allocate(9, ARENA).air.grid)


def test_fields_of_several_sources_add_with_their_strengths(tmp_path: Path) -> None:
    a, b = saved(tmp_path), saved(tmp_path, "b.npz", seed=9)
    places, strengths = points(2), np.array([[1.0, 3.0], [0.5, 0.25]])
    both = smelt(FieldPlume(fields=(a, b)), [0, 1], [4, 9], places, strengths=strengths)
    alone = [smelt(FieldPlume(fields=(name,)), [0, 1], [4, 9], places) for name in (a, b)]
    np.testing.assert_allclose(both, strengths[:, :1] * alone[0] + strengths[:, 1:] * alone[1], rtol=1e-12)


def test_the_sources_of_a_summed_field_need_equal_strengths(tmp_path: Path) -> None:
    card = {"sources": [{"position": [1.0, 1.0, 0.5]}, {"position": [2.0, 1.0, 0.5]}]}
    plume = FieldPlume(fields=(saved(tmp_path, card=card),), offset=(0.5, 0.0, 0.0))
    assert plume.source_positions().tolist() == [[1.5, 1.0, 0.5], [2.5, 1.0, 0.5]]
    assert smelt(plume, [0], [1], points(1), strengths=np.array([[2.0, 2.0]])).shape == (1, 5)
    with pytest.raises(InputError, match="must be equal"):
        smelt(plume, [0], [1], points(1), strengths=np.array([[2.0, 1.0]]))


def test_there_is_no_gas_outside_the_grid(tmp_path: Path) -> None:
    plume = FieldPlume(fields=(saved(tmp_path),))
    outside = np.array([[[-0.01, 1.0, 0.5], [3.01, 1.0, 0.5], [1.0, 2.5, 0.5], [1.0, 1.0, 7.0]]])
    assert np.array_equal(smelt(plume, [0], [3], outside), np.zeros((1, 4)))
    assert np.all(smelt(plume, [0], [3], np.array([[[0.0, 0.0, 0.0], list(ARENA.size)]])) > 0)


def test_pictures_show_what_is_read(tmp_path: Path) -> None:
    plume, within = FieldPlume(fields=(saved(tmp_path),)), scene(3)
    state = plume.allocate(3, 1, ARENA)
    plume.begin(state, within, np.arange(3), np.arange(3))
    plume.advance(state, within, np.array([False, True, False]))
    places, out = points(3), np.empty((3, 5))
    plume.read(state, within, places, np.ones(3, np.bool_), out)
    assert np.array_equal(plume.at(state, within, 1, places[1]), out[1])
    assert plume.at(state, within, 1, places.reshape(3, 5, 1, 3)).shape == (3, 5, 1)


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"field": "no-such-field"}, "unknown field"),
        ({"field": "gas.npz"}, "holds no wind"),
        ({"field": "a.npz", "offset": (0.5, 0.0, 0.0)}, r"covers \[0.5, 3.5\] x .* must cover the area \[0, 3\]"),
        ({"field": "a.npz", "random_start": True, "loop": False}, "needs loop"),
        ({"field": "bad.npz"}, "bad.npz"),
    ],
)
def test_winds_that_do_not_fit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    saved(tmp_path)
    saved(tmp_path, "gas.npz", wind=None)
    (tmp_path / "bad.npz").write_bytes(b"bad")
    FieldWind(field="a.npz").check(ARENA)
    with pytest.raises(ValueError, match=word):
        FieldWind(**parameters).check(ARENA)


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({}, "at least one field"),
        ({"fields": "wind.npz"}, "holds no concentration"),
        ({"fields": ("a.npz", "a.npz")}, "gas of 2 sources, and the scenario has 1"),
        ({"fields": ("a.npz", "grams.npz")}, "must be the same"),
        ({"fields": "a.npz", "offset": (0.0, 0.0, -0.5)}, "must cover the area"),
        ({"fields": "a.npz", "random_start": True, "loop": False}, "needs loop"),
    ],
)
def test_plumes_that_do_not_fit_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any], word: str
) -> None:
    monkeypatch.chdir(tmp_path)
    saved(tmp_path)
    saved(tmp_path, "wind.npz", concentration=None)
    saved(tmp_path, "grams.npz", unit="g/m^3")
    FieldPlume(fields=("a.npz",)).check(ARENA, 1)
    with pytest.raises(ValueError, match=word):
        FieldPlume(**parameters).check(ARENA, 1)
