"""`osl plume`: pictures, figures, files in and out; what it draws is what the plume and the field say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from osl_env import load_scenario
from osl_env.fields import Field, read_field, save_field
from osl_env.geometry import SOLID
from osl_env.parameters import FloatArray
from training.cli import main
from training.plume_pictures import Picture, horizontal, moments, upright
from training.plume_recording import record, table
from training.plume_statistics import distances, measure
from training.plume_subjects import RecordedField, SimulatedPlume, Subject, find_subject

QUICK = ["--frames", "3", "--json"]
RATE = "rate-60x60x30"


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def rate() -> SimulatedPlume:
    return SimulatedPlume(load_scenario(RATE), 0)


def small_field(*, gas: bool = True, wind: bool = True, n_frames: int = 4) -> Field:
    """6 x 4 x 2 m in cells of 1 m: wind along +x that grows in time, gas behind the source, a solid block."""
    shape = (6, 4, 2)
    solid = np.zeros(shape, np.uint8)
    solid[3, 0] = SOLID
    air = np.zeros((n_frames, *shape, 3), np.float32)
    air[..., 0] = 1.0 + 0.5 * np.arange(n_frames)[:, None, None, None]
    amount = np.zeros((n_frames, *shape), np.float32)
    amount[:, 1:, 2] = 8.0 / np.arange(1, 6)[None, :, None]
    amount[1::2] *= 0.01  # every other frame the plume is elsewhere
    return Field(
        times=np.arange(n_frames) * 1.0,
        origin=np.full(3, 0.5),
        spacing=np.ones(3),
        wind=air if wind else None,
        concentration=amount if gas else None,
        solid=solid,
        card={"title": "small", "sources": [{"position": [0.5, 2.5, 0.5]}]},
    )


def wandering(**changes: Any) -> SimulatedPlume:
    """The rate plume in a wind that meanders."""
    return SimulatedPlume(load_scenario(RATE, wind={"kind": "meander"}, **changes), 1)


def test_show_writes_a_picture_and_an_animation(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plume", "show", RATE, *QUICK]) == 0
    files = [Path(name) for name in json.loads(capsys.readouterr().out)["files"]]
    assert files == [Path(f"results/plumes/{RATE}") / name for name in ("picture.png", "animation.gif")]
    with Image.open(files[0]) as picture, Image.open(files[1]) as animation:
        assert picture.width > 900
        assert animation.n_frames == 3  # type: ignore[attr-defined]
        assert animation.info["duration"] == 100
        first = np.asarray(animation.convert("RGB"), dtype=float)
        animation.seek(2)
        assert np.abs(np.asarray(animation.convert("RGB"), dtype=float) - first).max() > 50


def test_show_draws_fields_and_prints_paths(empty_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, field in {"both": small_field(), "wind": small_field(gas=False), "gas": small_field(wind=False)}.items():
        save_field(field, f"{name}.npz")
        assert main(["plume", "show", f"{name}.npz", "--no-animation", "--out", name]) == 0
        assert capsys.readouterr().out == f"{name}/picture.png\n"
        assert [path.name for path in (empty_folder / name).iterdir()] == ["picture.png"]


@pytest.mark.parametrize("velocity", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.6, 0.8, 0.0), (0.0, 0.0, 0.0)])
def test_slices_go_through_the_source_and_end_at_the_bounds(velocity: tuple[float, float, float]) -> None:
    subject = SimulatedPlume(load_scenario(RATE, wind={"velocity": velocity}), 0)
    wall, flat = upright(subject), horizontal(subject, 3.0)
    for a in (*wall.a, 0.0):
        place = wall.start + a * wall.along
        assert np.all((place[:2] >= subject.low[:2] - 1e-9) & (place[:2] <= subject.high[:2] + 1e-9))
        on_edge = np.isclose(place[:2], subject.low[:2]) | np.isclose(place[:2], subject.high[:2])
        assert on_edge.any() == (a != 0.0)
    np.testing.assert_allclose(wall.start[:2], subject.sources[0, :2])
    speed = np.linalg.norm(velocity)
    assert speed == 0 or np.allclose(wall.along, np.array(velocity) / speed)
    a, b, places = flat.places(6, 3)
    assert places.shape == (3, 6, 3)
    np.testing.assert_allclose(places[1, 4], (a[4], b[1], 3.0))


def test_a_picture_shows_the_readings(rate: SimulatedPlume) -> None:
    picture = Picture(rate)
    shades = picture.flat.image.get_array()
    a, b, places = picture.flat.plane.places(*shades.shape[::-1])
    expected = rate.readings(places)
    seen = ~np.ma.getmaskarray(shades)
    np.testing.assert_allclose(shades.data[seen], expected[seen])
    assert np.all(expected[~seen] < picture.flat.image.norm.vmin)
    assert 0.1 < seen.mean() < 0.9
    row, column = np.unravel_index(np.argmax(expected), expected.shape)
    assert abs(a[column] - rate.sources[0, 0]) <= 60 / 140
    assert abs(b[row] - rate.sources[0, 1]) <= 60 / 140


def test_moments_go_on_in_time_or_through_the_heights(rate: SimulatedPlume) -> None:
    def seen(subject: Subject, seconds: float) -> list[tuple[float, FloatArray]]:
        picture = Picture(subject)
        return [(subject.time, picture.flat.image.get_array().filled(0.0)) for _ in moments(picture, seconds, 3)]

    lifted = seen(rate, 9.0)
    assert [time for time, _ in lifted] == [0.0, 0.0, 0.0]
    assert lifted[0][1].max() < lifted[2][1].max()  # the source is near the top
    moved = seen(wandering(), 9.0)
    assert [time for time, _ in moved] == [3.0, 6.0, 9.0]
    assert not np.array_equal(moved[0][1], moved[2][1])


def test_obstacles_are_drawn_where_they_are() -> None:
    box = {"kind": "box", "low": [12, 15, 0], "high": [20, 30, 5]}
    pole = {"kind": "cylinder", "center": [40, 20], "radius": 3}
    subject = SimulatedPlume(load_scenario(RATE, arena={"obstacles": [box, pole]}), 0)
    places = np.array([[15, 20, 1], [15, 20, 6], [25, 20, 1], [40, 22.9, 29], [42.5, 22.5, 1]], dtype=float)
    assert subject.solid(places).tolist() == [True, False, False, True, False]
    field = RecordedField(small_field(), "small")
    inside = np.array([[3.5, 0.5, 1.5], [3.5, 1.5, 0.5], [-9.0, 0.5, 0.5]])
    assert field.solid(inside).tolist() == [True, False, False]


def test_statistics_of_a_steady_plume_are_its_mean(rate: SimulatedPlume) -> None:
    found = measure(rate, 100.0, 1.0)
    assert found.samples == 1
    away = np.array([station.distance for station in found.stations])
    line = rate.sources[0] + away[:, None] * np.array([0.0, -1.0, 0.0])
    np.testing.assert_allclose([station.mean for station in found.stations], rate.readings(line))
    assert all(station.variation is None for station in found.stations)
    np.testing.assert_allclose(found.mean_wind, [0, -1, 0])


def test_statistics_of_a_field_that_comes_and_goes() -> None:
    found = measure(RecordedField(small_field(), "small"), 40.0, 1.0)
    one = next(station for station in found.stations if station.distance == 1.0)
    # 8 and 0.08 ppm in turn, each of the 40 samples on a frame
    assert one.mean == pytest.approx(4.04)
    assert one.peak == pytest.approx(8.0)
    assert one.intermittency == pytest.approx(0.5)
    assert one.variation == pytest.approx(3.96 / 4.04)
    assert one.whiffs == pytest.approx(19 / 39 * 60)
    np.testing.assert_allclose(found.mean_wind, [1.75, 0, 0])
    np.testing.assert_allclose(found.wind_rms, [np.std([1, 1.5, 2, 2.5]), 0, 0], atol=1e-6)


def test_distances_are_round_and_in_reach() -> None:
    assert distances(49.8).tolist() == [0.5, 1, 2, 5, 10, 20]
    np.testing.assert_allclose(distances(5.5), [0.1, 0.2, 0.5, 1, 2, 5])
    assert distances(0.0).size == 0


def test_stats_prints_80_columns_or_json(capsys: pytest.CaptureFixture[str]) -> None:
    save_field(small_field(), "small.npz")
    for name in (RATE, "small.npz"):
        assert main(["plume", "stats", name, "--seconds", "10"]) == 0
        out = capsys.readouterr().out
        assert "intermittency" in out
        assert "largest speed" in out
        assert max(map(len, out.splitlines())) <= 80
        assert main(["plume", "stats", name, "--seconds", "10", "--json"]) == 0
        content = json.loads(capsys.readouterr().out)
        assert content["stations"][0]["mean"] > 0
        assert content["unit"] == ("1/s" if name == RATE else "ppm")


def test_a_recorded_plume_plays_back_as_it_was() -> None:
    live, again = wandering(), wandering()
    field = record(live, 4.0, 2.0, 10.0)
    assert (field.n_frames, field.shape, field.unit) == (3, (6, 6, 3), "1/s")
    assert field.covers((60, 60, 30))
    places = np.array([[45.0, 15.0, 25.0], [25.0, 35.0, 5.0]])
    again.go_on(2.0)
    np.testing.assert_allclose(field.at("concentration", places, 2.0), again.readings(places), rtol=1e-6)
    np.testing.assert_allclose(field.at("wind", places, 2.0), again.winds(places), rtol=1e-6)
    np.testing.assert_allclose(field.sources, again.sources)


def test_export_writes_fields_tables_and_gaden(empty_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_field(small_field(), "small.npz")
    assert main(["plume", "export", RATE, "--spacing", "10", "--output", "a.npz"]) == 0
    assert read_field("a.npz").shape == (6, 6, 3)
    assert main(["plume", "export", "small.npz", "--format", "csv"]) == 0
    frame = pd.read_csv(empty_folder / "results/plumes/small.csv")
    assert list(frame.columns) == ["time_s", "x_m", "y_m", "z_m", "concentration_ppm", "u_m_s", "v_m_s", "w_m_s"]
    assert len(frame) == len(table(small_field())) == 4 * (48 - 2)
    assert main(["plume", "export", "small.npz", "--format", "png", "--output", "a.png"]) == 0
    assert main(["plume", "export", "small.npz", "--format", "gaden"]) == 0
    assert (empty_folder / "results/plumes/small-gaden/OccupancyGrid3D.csv").is_file()
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 5
    assert said[-1].endswith("osl plume import results/plumes/small-gaden --step 1")
    assert main(["plume", "import", "results/plumes/small-gaden", "--output", "back.npz", "--step", "1"]) == 0
    assert capsys.readouterr().out.startswith("gaden: 4 frames, 6 x 4 x 2 cells")
    back = read_field("back.npz")
    assert back.concentration is not None
    assert back.times.tolist() == [0.0, 1.0, 2.0, 3.0]
    np.testing.assert_allclose(back.concentration, small_field().concentration, rtol=2e-3)  # a field file rounds


@pytest.mark.parametrize("kind", ["npz", "gaden"])
def test_a_stopped_export_leaves_nothing(kind: str, empty_folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def write_some_and_stop(path: Path, *_: Any) -> None:
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    writer = "osl_env.fields.storage.write_arrays" if kind == "npz" else "osl_env.fields.gaden.write_result"
    monkeypatch.setattr(writer, write_some_and_stop)
    words = ["plume", "export", "gaden-60x60x30", "--seconds", "1", "--spacing", "10", "--format", kind]
    assert main([*words, "--output", f"stopped.{kind}"]) == 130
    assert [path for path in empty_folder.rglob("*") if path.is_file()] == []


def test_names(empty_folder: Path) -> None:
    save_field(small_field(), "small.npz")
    assert isinstance(find_subject("small.npz", 0), RecordedField)
    assert isinstance(find_subject(RATE, 0), SimulatedPlume)
    (empty_folder / "mine.yaml").write_text(f"base: {RATE}\nwind: {{kind: turbulent, nodes: 8}}\n")
    assert not find_subject("mine.yaml", 3, {"team.n_uavs": 1}).uniform_wind


def test_list_fields(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "fields"]) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


BAD = [
    (["plume"], "show, stats, import, export"),
    (["plume", "draw", RATE], "draw"),
    (["plume", "show"], "NAME"),
    (["plume", "show", "rate-60x60"], f"did you mean '{RATE}'"),
    (["plume", "show", "nothing.npz"], "nothing.npz: cannot be read (No such file or directory)"),
    (["plume", "show", "nothing.yaml"], "nothing.yaml"),
    (["plume", "show", "bad.npz"], "bad.npz"),
    (["plume", "show", RATE, "--seconds", "-1"], "--seconds -1: must be above 0"),
    (["plume", "show", RATE, "--seconds", "nan"], "--seconds nan"),
    (["plume", "show", RATE, "--seconds", "1e9"], "--seconds 1e+09: must be at most 86400"),
    (["plume", "show", RATE, "--fps", "0"], "--fps 0"),
    (["plume", "show", RATE, "--frames", "0"], "--frames 0"),
    (["plume", "show", RATE, "--frames", "100000"], "at most"),
    (["plume", "show", RATE, "--seed", "-1"], "seed = -1"),
    (["plume", "show", RATE, "--set", "wind.speed=1"], "speed"),
    (["plume", "show", RATE, "--output", "/proc/none"], "/proc/none"),
    (["plume", "stats", RATE, "--interval", "0"], "--interval 0"),
    (["plume", "stats", RATE, "--interval", "500"], "--interval 500"),
    (["plume", "import", "nowhere"], "nowhere: no such folder"),
    (["plume", "import", "bad.npz"], "bad.npz: is a file; expected the folder"),
    (["plume", "import", "empty"], "neither an OpenFOAM case"),
    (["plume", "import", "empty", "--format", "fluent"], "fluent"),
    (["plume", "import", "empty", "--step", "0"], "--step 0: must be above 0"),
    (["plume", "import", "empty", "--format", "openfoam", "--step", "1"], "are for GADEN"),
    (["plume", "import", "empty", "--format", "gaden", "--spacing", "1"], "--spacing 1"),
    (["plume", "import", "empty", "--format", "gaden"], "empty"),
    (["plume", "import", "empty", "--format", "openfoam"], "empty"),
    (["plume", "export", RATE, "--spacing", "0.01"], "GiB"),
    (["plume", "export", RATE, "--spacing", "inf"], "--spacing inf"),
    (["plume", "export", RATE, "--seconds", "1e9"], "--seconds 1e+09: must be from 0 to 86400"),
    (["plume", "export", RATE, "--format", "gaden"], "ppm"),
    (["plume", "export", "tunnel-a", "--format", "gaden", "--output", "."], ".: is not an empty folder"),
    (["plume", "export", RATE, "--format", "csv", "--output", "a.npz"], "suffix must be .csv"),
]


@pytest.mark.parametrize(
    ("words", "complaint"), BAD, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_bad_input_is_one_line_and_exit_code_two(
    words: list[str], complaint: str, empty_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (empty_folder / "empty").mkdir()
    (empty_folder / "bad.npz").write_bytes(b"PK\x03\x04 not a field")
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("osl: ")
    assert err.count("\n") == 1
    assert complaint in err
    assert [path.name for path in empty_folder.rglob("*") if path.is_file()] == ["bad.npz"]  # nothing half-written
