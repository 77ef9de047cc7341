"""A field on a grid: what it checks, its interpolation, its file and its library."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from osl_env.errors import InputError
from osl_env.fields import Field, field_names, load_field, read_field, save_field, statistics
from osl_env.geometry import SOLID


def linear(n_t: int = 4, period: float = 0.0) -> Field:
    """A field whose wind and concentration are linear in space and in time."""
    axes = [np.arange(n) for n in (n_t, 5, 4, 3)]
    t, x, y, z = np.meshgrid(*axes, indexing="ij")
    u = 0.5 * t + 0.2 * x - 0.1 * y + 0.05 * z
    wind = np.stack([u, -2 * u, 0.3 * u], axis=-1).astype(np.float32)
    gas = (7 + t + 2 * x + 3 * y + 4 * z).astype(np.float32)
    return Field(2.0 * np.arange(n_t), [1.0, 2.0, 0.25], [0.5, 1.0, 0.5], wind, gas, period=period)


def gusts(shape: tuple[int, ...] = (20, 12, 8, 1), seed: int = 0, period: float = 5.0) -> Field:
    wind = np.zeros((*shape, 3), np.float32)
    wind[..., :2] = np.random.default_rng(seed).normal(0.5, 0.6, (*shape, 2))
    return Field(0.25 * np.arange(shape[0]), [0.1, 0.1, 0.1], [0.2, 0.2, 0.2], wind, period=period)


def test_interpolation_is_exact_on_a_linear_field() -> None:
    field = linear()
    rng = np.random.default_rng(1)
    place = rng.uniform(0, 1, (50, 3)) * (np.array(field.shape) - 1)
    for time in (0.0, 1.3, 5.9, 6.0):
        u = 0.25 * time + place @ [0.2, -0.1, 0.05]
        points = field.origin + place * field.spacing
        expected = np.stack([u, -2 * u, 0.3 * u], axis=-1)
        np.testing.assert_allclose(field.at("wind", points, time), expected, atol=2e-6)  # float32
        gas = 7 + time / 2 + place @ [2, 3, 4]
        np.testing.assert_allclose(field.at("concentration", points, time), gas, rtol=1e-6)


def test_outside_the_grid_the_nearest_wind_holds_and_there_is_no_gas() -> None:
    field = linear()
    far = np.array([[-50.0, 3.0, 0.5], [1.5, 99.0, 0.5], [1.5, 3.0, -9.0]])
    near = np.clip(far, field.origin, field.origin + field.spacing * (np.array(field.shape) - 1))
    assert np.array_equal(field.at("wind", far, 1.0), field.at("wind", near, 1.0))
    assert np.array_equal(field.at("concentration", far, 1.0), np.zeros(3))
    assert np.all(field.at("concentration", [field.low, field.high], 1.0) > 0)  # the edges are in the grid


def test_a_loop_has_no_seam() -> None:
    field = linear(period=8.0)
    point = field.origin + field.spacing
    steps = np.linspace(-8.0, 16.0, 2401)
    values = np.array([field.at("concentration", point, t) for t in steps])
    np.testing.assert_allclose(values[:800], values[800:1600], rtol=1e-9)
    slope = 3.0 / 2.0  # from the last frame back to the first: 3 units in 2 s
    assert np.abs(np.diff(values)).max() <= slope * 0.01 * (1 + 1e-6)
    held = [field.at("concentration", point, t, loop=False) for t in (-5.0, 6.0, 60.0)]
    first, last = field.at("concentration", point, 0.0), field.at("concentration", point, 6.0)
    assert held == [first, last, last]


def test_a_field_that_was_not_made_to_loop_blends_back_in_one_interval() -> None:
    field = linear()
    assert field.loop_period == 8.0
    middle = field.at("concentration", field.origin, 7.0)
    assert middle == pytest.approx(7 + 1.5)


def test_a_single_frame_is_steady() -> None:
    field = linear(1)
    point = field.origin + 0.3 * field.spacing
    assert len({float(field.at("concentration", point, t)) for t in (-3.0, 0.0, 0.4, 1e9)}) == 1


def test_gas_is_not_read_through_a_wall_nor_lost_to_it() -> None:
    gas = np.zeros((1, 7, 3, 1), np.float32)
    gas[:, :3], gas[:, 4:] = 5.0, 80.0
    solid = np.zeros((7, 3, 1), np.uint8)
    solid[3] = SOLID
    field = Field([0.0], [0.5, 0.5, 0.5], [1.0, 1.0, 1.0], concentration=gas, solid=solid)
    x = np.linspace(0, 7, 71)
    read = field.at("concentration", np.stack([x, np.full(71, 1.5), np.full(71, 0.5)], axis=-1), 0.0)
    np.testing.assert_allclose(read[x < 3.4999], 5.0, rtol=1e-12)
    np.testing.assert_allclose(read[x > 3.5001], 80.0, rtol=1e-12)


def test_coverage_counts_the_cells_and_the_offset() -> None:
    field = gusts()
    assert np.allclose(field.low, 0)
    assert np.allclose(field.high, [2.4, 1.6, 0.2])
    assert field.covers((2.4, 1.6, 30.0))  # one layer holds at all heights
    assert not field.covers((2.5, 1.6, 0.2))
    assert field.covers((2.0, 1.0, 0.2), (-0.4, 0.0, 0.0))
    assert not field.covers((2.0, 1.0, 0.2), (0.1, 0.0, 0.0))


def test_frames_and_layers_are_parts() -> None:
    field = linear(period=8.0)
    part = field.frames(1, 3)
    assert part.times.tolist() == [2.0, 4.0]
    assert part.period == 0
    assert np.array_equal(part.wind, field.wind[1:3])  # type: ignore[index]
    layer = field.layer(0.6)
    assert layer.shape == (5, 4, 1)
    assert layer.origin[2] == field.origin[2] + field.spacing[2]
    assert np.array_equal(layer.concentration[..., 0], field.concentration[..., 1])  # type: ignore[index]
    with pytest.raises(InputError, match="frames = 2:9"):
        field.frames(2, 9)


BAD: list[tuple[dict[str, Any], str]] = [
    ({"times": [0.0, 2.0, 2.0, 3.0]}, "frame 2 at 2 s must come after frame 1 at 2 s"),
    ({"times": [0.0, 2.0, np.nan, 3.0]}, "times: every number must be finite"),
    ({"times": [0.0, 1.0]}, r"must be \(2, nx"),
    ({"spacing": [1.0, 0.0, 1.0]}, "above 0"),
    ({"origin": [1.0, 0.0]}, "origin: has shape"),
    ({"period": 6.0}, "must be longer than the frames"),
    ({"period": np.inf}, "period"),
    ({"wind": np.full((4, 5, 4, 3, 3), np.nan)}, "wind: holds values from nan"),
    ({"wind": np.full((4, 5, 4, 3, 3), 1e4)}, "within 1000"),
    ({"concentration": np.full((4, 5, 4, 3), -1.0)}, "must not be below 0"),
    ({"concentration": np.zeros((4, 5, 4, 2))}, "must be the wind's"),
    ({"wind": None, "concentration": None}, "at least one"),
    ({"solid": np.zeros((5, 4, 2), np.uint8)}, "must be the grid's"),
    ({"solid": np.full((5, 4, 3), 7)}, "0 .free., 1 .solid. or 2"),
    ({"unit": ""}, "unit"),
    ({"card": {"a": np.nan}}, "JSON"),
    ({"card": {"sources": [{"position": [1, 2]}]}}, "sources.0.position"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_fields_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(linear(), **change)


def test_the_arrays_are_read_only() -> None:
    field = linear()
    with pytest.raises(ValueError, match="read-only"):
        field.wind[0] = 0  # type: ignore[index]
    with pytest.raises(dataclasses.FrozenInstanceError):
        field.period = 3.0  # type: ignore[misc]


@pytest.mark.parametrize("step", [0.01, 0.001, 1e-5, 0.0])
def test_a_saved_wind_is_within_half_a_step(tmp_path: Path, step: float) -> None:
    field = gusts()
    save_field(field, tmp_path / "a.npz", wind_step=step)
    again = read_field(tmp_path / "a.npz")
    assert again.wind is not None
    assert np.abs(again.wind - field.wind).max() <= 0.5 * step + 1e-7  # float32
    assert (again.period, again.unit, again.solid) == (field.period, field.unit, None)
    assert np.array_equal(again.times, field.times)
    assert np.array_equal(again.origin, field.origin)
    assert np.array_equal(again.spacing, field.spacing)


def test_a_saved_concentration_keeps_its_digits_over_all_magnitudes(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    gas = (10.0 ** rng.uniform(-30, 20, (6, 4, 3, 2))).astype(np.float32)
    gas[rng.uniform(size=gas.shape) < 0.3] = 0
    solid = rng.integers(0, 3, (4, 3, 2)).astype(np.uint8)
    card = {"title": "é", "sources": [{"position": [1.0, 2.0, 3.0]}]}
    field = Field(np.arange(6), np.zeros(3), np.ones(3), concentration=gas, unit="g/m^3", solid=solid, card=card)
    for mantissa in (10, 23):
        save_field(field, tmp_path / "a.npz", mantissa=mantissa)
        again = read_field(tmp_path / "a.npz")
        np.testing.assert_allclose(again.concentration, gas, rtol=0 if mantissa == 23 else 2.0**-11, atol=0)
        assert np.array_equal(again.solid, solid)
        assert (again.card, again.unit, again.wind) == (card, "g/m^3", None)
        assert np.array_equal(again.sources, [[1.0, 2.0, 3.0]])


def test_the_same_field_gives_the_same_bytes_that_numpy_can_load(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        save_field(gusts(), tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert arrays["wind"].shape[1:] == (2, 20, 12, 8, 1)
        assert b"osl-field" in arrays["header"].tobytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.npz"]


def test_smooth_winds_compress_to_less_than_half_a_byte_a_number(tmp_path: Path) -> None:
    t, x, y = np.meshgrid(np.arange(60), np.arange(40), np.arange(30), indexing="ij")
    wind = np.zeros((60, 40, 30, 1, 3))
    wind[..., 0, 0] = 0.5 + 0.2 * np.sin(0.3 * x - 0.2 * t) * np.cos(0.2 * y)
    wind[..., 0, 1] = 0.2 * np.cos(0.3 * x - 0.2 * t) * np.sin(0.2 * y)
    save_field(Field(np.arange(60), np.zeros(3), np.ones(3), wind), tmp_path / "a.npz")
    assert (tmp_path / "a.npz").stat().st_size < 0.5 * 2 * t.size


def test_what_cannot_be_saved_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must end in \.npz"):
        save_field(gusts(), tmp_path / "a.csv")
    with pytest.raises(InputError, match="cannot be written"):
        save_field(gusts(), tmp_path / "none" / "a.npz")
    with pytest.raises(InputError, match="wind_step"):
        save_field(gusts(), tmp_path / "a.npz", wind_step=-1)
    with pytest.raises(InputError, match="mantissa"):
        save_field(gusts(), tmp_path / "a.npz", mantissa=24)


def test_a_field_is_loaded_once_until_its_file_changes(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    save_field(gusts(), path)
    first = load_field(path)
    assert load_field(str(path)) is first
    save_field(gusts(seed=1, shape=(21, 12, 8, 1), period=6.0), path)
    assert load_field(path).n_frames == 21
    with pytest.raises(InputError, match="cannot be read"):
        load_field(tmp_path / "b.npz")


def test_shipped_fields_are_found_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "fields").mkdir()
    save_field(gusts(), tmp_path / "fields" / "arena-test.npz")
    monkeypatch.setattr("osl_env.fields.library.config_folder", lambda: tmp_path)
    assert field_names() == ["arena-test"]
    assert load_field("arena-test").shape == (12, 8, 1)
    with pytest.raises(InputError, match="did you mean 'arena-test'"):
        load_field("arena-tset")
    with pytest.raises(InputError, match="unknown field"):
        load_field("a\0b")
    with pytest.raises(InputError, match="unknown field"):
        load_field("a" * 5000)


def test_statistics_of_known_fields() -> None:
    field = gusts((400, 12, 8, 1), period=100.0)
    numbers = statistics(field)
    wind = numbers["wind"]
    n = 400 * 12 * 8
    assert wind["mean_m_s"][0] == pytest.approx(0.5, abs=5 * 0.6 / n**0.5)  # 5 standard errors
    assert wind["rms_m_s"][:2] == pytest.approx([0.6, 0.6], abs=0.01)
    assert numbers["cells"] == [12, 8, 1]
    gas = np.zeros((10, 3, 1, 1), np.float32)
    gas[:, 0], gas[::2, 1] = 4.0, 2.0
    steady = statistics(Field(np.arange(10), np.zeros(3), np.ones(3), concentration=gas))["concentration"]
    assert steady["largest"] == 4
    assert steady["plume_fraction"] == pytest.approx(2 / 3, abs=1e-3)
    assert steady["coefficient_of_variation"] == 0.5  # 0 where it is steady, 1 where it is there half of the time
    assert steady["intermittency"] == 0.75


def test_the_mean_wind_is_that_of_the_air() -> None:
    wind = np.zeros((2, 2, 1, 1, 3), np.float32)
    wind[:, 1, ..., 0] = [[[1.0]], [[3.0]]]
    solid = np.array([[[SOLID]], [[0]]], np.uint8)
    assert Field([0, 1], np.zeros(3), np.ones(3), wind, solid=solid).mean_wind.tolist() == [2.0, 0.0, 0.0]
