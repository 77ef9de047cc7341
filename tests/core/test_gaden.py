"""GADEN's files of every version, written here byte by byte from their listed layouts."""

from __future__ import annotations

import math
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from osl_env.errors import InputError
from osl_env.fields import Field
from osl_env.fields.gaden import export_gaden, import_gaden
from osl_env.fields.gaden_grid import Occupancy, read_occupancy, read_wind
from osl_env.fields.gaden_raster import concentration_of
from osl_env.fields.gaden_results import GadenResult, read_result
from osl_env.geometry import OUTLET, SOLID

SHAPE, CELL, LOW = (4, 3, 2), 0.5, (-1.0, 2.0, 0.25)
N = math.prod(SHAPE)
CELLS = [(x, y, z) for z in range(SHAPE[2]) for y in range(SHAPE[1]) for x in range(SHAPE[0])]  # GADEN's order
AIR = 1.0 / (82.057338 * 298.0)
MOLES = 20e-6 * AIR * (2 * math.pi) ** 1.5 * 30.0**3  # 20 ppm at the centre of sigma = 30 cm


def velocity(x: int, y: int, z: int) -> tuple[float, float, float]:
    return x + 0.5, -10.0 * y, 100.0 * z + 0.25  # each exact in float32


EXPECTED = np.array([[[velocity(x, y, z) for z in range(2)] for y in range(3)] for x in range(4)])


def occupancy_text(**changes: str) -> str:
    lines = {"env_min(m)": "-1 2 0.25", "env_max(m)": "1 3.5 1.25", "num_cells": "4 3 2", "cell_size(m)": "0.5"}
    head = "".join(f"#{key} {value}\n" for key, value in (lines | changes).items())
    bottom = "1 1 1 \n0 0 0 \n0 0 0 \n0 0 2 \n;\n"  # a line for each x, all y
    return head + bottom + "0 0 0 \n0 1 0 \n0 0 0 \n0 0 2 \n;\n"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "OccupancyGrid3D.csv").write_text(occupancy_text())
    return tmp_path


def grid(root: Path) -> Occupancy:
    return read_occupancy(root / "OccupancyGrid3D.csv")


def test_an_occupancy_grid_is_read(root: Path) -> None:
    read = grid(root)
    assert (read.shape, read.cell, read.low.tolist()) == (SHAPE, CELL, list(LOW))
    expected = np.zeros(SHAPE)
    expected[0, :, 0] = SOLID
    expected[1, 1, 1] = SOLID
    expected[3, 2, :] = OUTLET
    assert np.array_equal(read.solid, expected)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "env_min"),
        (occupancy_text().replace("0 0 2", "0 0 3"), "expected 0, 1 or 2"),
        (occupancy_text().replace("0 0 2", "0 0"), "each of 3 cells"),
        (occupancy_text()[:-20], "cut off"),
        (occupancy_text().replace(";", "", 1), "layers"),
        (occupancy_text() + "0 0 0\n", "layers"),
        (occupancy_text(**{"num_cells": "4000000 3000 2000"}), "at most"),
        (occupancy_text(**{"num_cells": "4 3.5 2"}), "whole numbers"),
        (occupancy_text(**{"cell_size(m)": "0"}), "above 0"),
        (occupancy_text(**{"cell_size(m)": "nan"}), "cell_size"),
        (occupancy_text(**{"env_min(m)": "1 2"}), "env_min"),
        (occupancy_text() + "\xff", "not text"),
    ],
)
def test_bad_occupancy_grids_are_refused(root: Path, text: str, word: str) -> None:
    path = root / "OccupancyGrid3D.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=word) as caught:
        read_occupancy(path)
    assert str(caught.value).startswith(f"{path}: ")


def csv(points_first: bool) -> str:
    rng = np.random.default_rng(0)
    velocities, points = [f'"U:{k}"' for k in range(3)], [f'"Points:{k}"' for k in range(3)]
    lines = [",".join(points + velocities if points_first else velocities + points)]
    for cell in rng.permutation(CELLS):
        place = np.array(LOW) + CELL * (cell + rng.uniform(0.1, 0.9, 3))
        point, air = [f"{v:.6g}" for v in place], [f"{v:.6g}" for v in velocity(*cell)]
        lines.append(",".join(point + air if points_first else air + point))
    return "\n".join(lines) + "\n"


def blocks(axis: int) -> bytes:
    return struct.pack(f"<{N}d", *(velocity(*cell)[axis] for cell in CELLS))


def packed() -> bytes:
    return struct.pack(f"<{3 * N}f", *(v for cell in CELLS for v in velocity(*cell)))


WINDS: dict[str, Callable[[Path], Path]] = {
    "csv, points first": lambda root: wrote(root / "wind_0.csv", csv(True).encode()),
    "csv, points last": lambda root: wrote(root / "wind_0.csv", csv(False).encode()),
    "U, V, W": lambda root: [
        wrote(root / f"wind_0.csv_{'UVW'[axis]}", struct.pack("<i", 999) + blocks(axis)) for axis in (2, 1, 0)
    ][-1],
    "2.5": lambda root: wrote(root / "wind_iteration_0", blocks(0) + blocks(1) + blocks(2)),
    "2.6": lambda root: wrote(root / "wind_iteration_0", packed()),
    "2.6, csv_gaden": lambda root: wrote(root / "wind_0.csv_gaden", packed()),
    "3.0": lambda root: wrote(root / "wind_iteration_0", struct.pack("<2i", 3, 0) + packed()),
}


def wrote(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("layout", WINDS)
def test_winds_of_every_layout_are_read(root: Path, layout: str) -> None:
    path = WINDS[layout](root)
    assert np.array_equal(read_wind(path, grid(root)), EXPECTED)
    field = import_gaden(root)
    assert field.wind is not None
    assert np.array_equal(field.wind[0], EXPECTED)
    assert field.concentration is None
    assert np.allclose(field.low, LOW)
    assert np.allclose(field.high, [1.0, 3.5, 1.25])


def test_points_share_their_cell_and_holes_take_the_nearest_wind(root: Path) -> None:
    lines = csv(True).splitlines()
    kept = [line for line in lines if not line.endswith(",3.5,-10,100.25")] + ["-0.9,2.1,0.9,10.5,20,100.25"]
    path = wrote(root / "wind_0.csv", "\n".join(kept).encode())
    read = read_wind(path, grid(root))
    assert read[0, 0, 1].tolist() == [5.5, 10.0, 100.25]  # the mean of two points
    near = [read[2, 1, 1], read[3, 0, 1], read[3, 2, 1], read[3, 1, 0]]
    assert any(np.array_equal(read[3, 1, 1], other) for other in near)


@pytest.mark.parametrize(
    ("name", "content", "word"),
    [
        ("wind_iteration_0", packed()[:-1], "expected 576, 288 or 296"),
        ("wind_iteration_0", packed() + bytes(1000), "at most"),
        ("wind_iteration_0", struct.pack("<2i", 4, 0) + packed(), "version 4.0"),
        ("wind_iteration_0", struct.pack("<f", math.nan) + packed()[4:], "not finite"),
        ("a_0.csv_U", struct.pack("<i", 998) + blocks(0), "999"),
        ("a_0.csv_U", struct.pack("<i", 999) + blocks(0)[:-8], "expected 196"),
        ("a_0.csv", b'"U:0","U:1","U:2"\n1,2,3\n', "Points"),
        ("a_0.csv", b'"U:0","U:1","U:2","Points:0","Points:1","Points:2"\n', "holds no points"),
        ("a_0.csv", b'"U:0","U:1","U:2","Points:0","Points:1","Points:2"\n1,2,3,x,5,6\n', "not readable"),
        ("a_0.csv", b'"U:0","U:1","U:2","Points:0","Points:1","Points:2"\n1,2,nan,3,5,6\n', "not finite"),
        ("a_0.csv", b'"U:0","U:1","U:2","Points:0","Points:1","Points:2"\n1,2,3,99,99,99\n', "another environment"),
        ("a_0.csv", b"\xff" * 100, "not readable"),
    ],
)
def test_bad_winds_are_refused(root: Path, name: str, content: bytes, word: str) -> None:
    for axis in "VW":
        wrote(root / f"a_0.csv_{axis}", struct.pack("<i", 999) + blocks(0))
    path = wrote(root / name, content)
    with pytest.raises(InputError, match=word) as caught:
        read_wind(path, grid(root))
    assert str(caught.value).startswith(f"{path}: ")


FILAMENTS = [(0.25, 2.75, 0.75, 30.0), (-0.5, 3.25, 1.0, 35.5)]
SOURCE, WIND, GAS = (0.5, 2.5, 0.5), 7, 1
HIGH = [low + CELL * n for low, n in zip(LOW, SHAPE, strict=True)]
AMOUNTS = [0.25 * k for k in range(N)]  # in GADEN's order of cells


def text(word: bytes) -> bytes:
    return struct.pack("<Q", len(word)) + word


def version_1(wind: int = WIND) -> bytes:
    head = struct.pack("<i3d3d3i3d3d", 1, *LOW, *HIGH, *SHAPE, *[CELL] * 3, *SOURCE)
    return head + struct.pack("<iddi", GAS, MOLES, AIR, wind) + records("d")


def version_2(minor: int, wind: int = WIND) -> bytes:
    real = "d" if minor <= 5 else "f"
    head = struct.pack("<2i3i3f3ff3f", 2, minor, *SHAPE, *LOW, *HIGH, CELL, *SOURCE)
    return head + struct.pack(f"<i2{real}i", GAS, MOLES, AIR, wind) + records(real)


def version_3(body: bytes, source: bytes = b"", kind: bytes = b"point", wind: int = WIND) -> bytes:
    head = struct.pack("<2i3i3f3ff", 3, 0, *SHAPE, *LOW, *HIGH, CELL) + text(kind) + source
    return head + struct.pack("<3fi2fi", *SOURCE, GAS, MOLES, AIR, wind) + body


def records(real: str) -> bytes:
    return b"".join(struct.pack(f"<i4{real}", k, *filament) for k, filament in enumerate(FILAMENTS))


def listed(flag: bytes) -> bytes:
    return struct.pack("<Q", len(FILAMENTS)) + b"".join(struct.pack("<4f", *f) + flag for f in FILAMENTS)


FILAMENT_RESULTS = {
    "1": version_1(),
    "2.0": version_2(0),
    "2.5": version_2(5),
    "2.6": version_2(6),
    "3.0 without a mode": version_3(records("f")),
    "3.0 with records": version_3(text(b"filaments") + records("f")),
    "3.0 with a list": version_3(text(b"filaments") + listed(b"\x01\0\0\0")),
    "3.0 with a short list": version_3(text(b"filaments") + listed(b"")),
    "3.0 box": version_3(text(b"filaments") + listed(b"\x01abc"), struct.pack("<3f", 1, 2, 3), b"box"),
    "3.0 line": version_3(text(b"filaments") + listed(b"\x01\0\0\0"), struct.pack("<3f", 1, 2, 3), b"line"),
    "3.0 sphere": version_3(text(b"filaments") + listed(b"\x01\0\0\0"), struct.pack("<f", 1), b"sphere"),
}
GAS_RESULTS = {
    "3.0 concentrations": version_3(text(b"concentrations") + struct.pack(f"<Q{N}f", N, *AMOUNTS)),
    "3.0 concentrations, no length": version_3(text(b"concentrations") + struct.pack(f"<{N}f", *AMOUNTS)),
}


def result(root: Path, raw: bytes, marked: bool = False, index: int = 0) -> Path:
    mark = b"GADEN_RESULT\0" + struct.pack("<Q", len(raw) + 1000) if marked else b""
    return wrote(root / f"iteration_{index}", mark + zlib.compress(raw))


@pytest.mark.parametrize("marked", [False, True])
@pytest.mark.parametrize("layout", [*FILAMENT_RESULTS, *GAS_RESULTS])
def test_results_of_every_version_are_read(root: Path, layout: str, marked: bool) -> None:
    read = read_result(result(root, (FILAMENT_RESULTS | GAS_RESULTS)[layout], marked))
    assert (read.shape, read.cell, read.low.tolist()) == (SHAPE, CELL, list(LOW))
    assert (read.source.tolist(), read.gas, read.wind_index) == (list(SOURCE), GAS, WIND)
    assert read.moles == pytest.approx(MOLES, rel=1e-6)
    assert read.air == pytest.approx(AIR, rel=1e-6)
    if layout in FILAMENT_RESULTS:
        assert read.filaments is not None
        assert read.filaments.tolist() == [list(filament) for filament in FILAMENTS]
        assert read.concentration is None
    else:
        assert read.filaments is None
        assert read.concentration is not None
        assert [read.concentration[cell] for cell in CELLS] == AMOUNTS


def with_filaments(filaments: list[tuple[float, float, float, float]]) -> GadenResult:
    return GadenResult(
        version=(3, 0), low=np.array(LOW), cell=CELL, shape=SHAPE, source=np.array(SOURCE), gas=0, moles=MOLES,
        air=AIR, wind_index=0, filaments=np.array(filaments).reshape(-1, 4),
    )  # fmt: skip


def open_grid(shape: tuple[int, int, int] = SHAPE, cell: float = CELL) -> Occupancy:
    return Occupancy(np.array(LOW), cell, np.zeros(shape, np.uint8))


def test_filaments_become_the_concentration_of_the_formula() -> None:
    gas = concentration_of(with_filaments(FILAMENTS), open_grid(), cutoff=3.0)
    for x, y, z in CELLS:
        centre = np.array(LOW) + CELL * (np.array([x, y, z]) + 0.5)
        total = 0.0
        for *place, sigma in FILAMENTS:
            square = float(((centre - place) ** 2).sum()) * 1e4
            if square <= (3 * sigma) ** 2:
                peak = 1e6 * MOLES / (AIR * (2 * math.pi) ** 1.5 * sigma**3)
                total += peak * math.exp(-square / (2 * sigma**2))
        assert gas[x, y, z] == pytest.approx(total, rel=1e-6)


def test_the_gas_of_a_filament_is_the_integral_of_its_concentration() -> None:
    shape, cell, sigma = (60, 60, 60), 0.05, 30.0
    centre = np.array(LOW) + 1.5
    gas = concentration_of(with_filaments([(*centre, sigma)]), open_grid(shape, cell), cutoff=5.0)
    # midpoint sums of a Gaussian converge faster than any power; 5 sigma leave 1.5e-5 of it outside
    assert gas.sum() * 1e-6 * AIR * (100 * cell) ** 3 == pytest.approx(MOLES, rel=1e-4)


def test_filaments_add_and_do_not_reach_behind_walls() -> None:
    alone = [concentration_of(with_filaments([f]), open_grid()) for f in FILAMENTS]
    np.testing.assert_allclose(concentration_of(with_filaments(FILAMENTS), open_grid()), sum(alone), rtol=1e-5)
    solid = np.zeros(SHAPE, np.uint8)
    solid[1] = SOLID
    walled = concentration_of(with_filaments([(0.75, 2.75, 0.75, 60.0)]), Occupancy(np.array(LOW), CELL, solid))
    assert np.all(walled[2:] > 0)
    assert not np.any(walled[:2])


def corrupted(raw: bytes, at: int, value: bytes) -> bytes:
    return raw[:at] + value + raw[at + len(value) :]


GOOD = GAS_RESULTS["3.0 concentrations"]
BAD_RESULTS: dict[str, tuple[bytes, str]] = {
    "version": (struct.pack("<i", 9) + bytes(200), "version 9"),
    "shape": (corrupted(GOOD, 8, struct.pack("<3i", 2**31 - 1, 2**31 - 1, 9)), "at most"),
    "no cells": (corrupted(GOOD, 8, struct.pack("<i", 0)), "at least one"),
    "cell": (corrupted(GOOD, 44, struct.pack("<f", math.nan)), "finite"),
    "low": (corrupted(GOOD, 20, struct.pack("<f", math.inf)), "finite"),
    "kind": (version_3(b"", kind=b"cone"), "cone"),
    "long text": (corrupted(GOOD, 48, struct.pack("<Q", 2**63)), "a text of"),
    "count": (version_3(text(b"concentrations") + struct.pack(f"<Q{N}f", N + 1, *AMOUNTS)), "expected 24"),
    "nan": (version_3(text(b"concentrations") + struct.pack(f"<Q{N}f", N, *AMOUNTS[:-1], math.nan)), "not finite"),
    "negative": (version_3(text(b"concentrations") + struct.pack(f"<Q{N}f", N, *AMOUNTS[:-1], -1)), "below 0"),
    "short": (GOOD[:-3], "expected 96"),
    "filaments": (FILAMENT_RESULTS["2.6"][:-1], "records of 20"),
    "sigma": (version_3(records("f")[:-4] + struct.pack("<f", 0)), "above 0"),
}


@pytest.mark.parametrize("case", BAD_RESULTS)
def test_bad_results_are_refused(root: Path, case: str) -> None:
    raw, word = BAD_RESULTS[case]
    path = result(root, raw)
    with pytest.raises(InputError, match=word) as caught:
        read_result(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("raw", [*FILAMENT_RESULTS.values(), *GAS_RESULTS.values()])
def test_cut_and_damaged_results_give_an_error_or_a_result(root: Path, raw: bytes) -> None:
    rng = np.random.default_rng(4)
    trials = [raw[:k] for k in range(0, len(raw), 5)]
    trials += [corrupted(raw, int(rng.integers(len(raw))), rng.bytes(2)) for _ in range(60)]
    messages = []
    for trial in trials:
        try:
            read = read_result(result(root, trial))
            assert (read.filaments is None) != (read.concentration is None)
        except InputError as error:
            messages.append(str(error))
    assert all("expected" in message for message in messages)
    whole = zlib.compress(raw)
    for k in range(0, len(whole), 11):
        with pytest.raises(InputError):
            read_result(wrote(root / "iteration_0", whole[:k]))
    with pytest.raises(InputError, match="after its end"):
        read_result(wrote(root / "iteration_0", whole + b"more"))


def test_a_result_that_inflates_without_end_is_refused_within_a_bound(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("osl_env.fields.gaden_results.MAX_RESULT", 1_000_000)
    path = wrote(root / "iteration_0", zlib.compress(bytes(50_000_000)))
    tracemalloc.start()
    with pytest.raises(InputError, match="longer than"):
        read_result(path)
    assert tracemalloc.get_traced_memory()[1] < 4_000_000
    tracemalloc.stop()


def simulation(root: Path, frames: int = 3) -> None:
    for k in range(2):
        wrote(root / "wind" / f"wind_iteration_{k}", struct.pack("<2i", 3, 0) + packed())
    for k in range(frames):
        gas = text(b"concentrations") + struct.pack(f"<Q{N}f", N, *(k + a for a in AMOUNTS))
        result(root / "simulations" / "sim1", version_3(gas, wind=k % 2), index=k)


def test_a_project_is_imported_whole_or_in_part(root: Path) -> None:
    simulation(root)
    field = import_gaden(root, save_step=0.25)
    assert field.times.tolist() == [0.0, 0.25, 0.5]
    assert field.wind is not None
    assert field.concentration is not None
    assert np.array_equal(field.wind[2], EXPECTED)
    assert [field.concentration[2][cell] for cell in CELLS] == [2 + a for a in AMOUNTS]
    assert field.card["sources"] == [{"position": list(SOURCE), "gas": "methane"}]
    assert np.array_equal(field.solid, grid(root).solid)  # type: ignore[arg-type]
    wind, gas = import_gaden(root, quantity="wind", wind_step=2.0), import_gaden(root, quantity="gas")
    assert wind.times.tolist() == [0.0, 2.0]
    assert wind.concentration is None
    assert gas.wind is None
    from_below = import_gaden(root / "simulations" / "sim1")  # finds the grid and the winds above
    assert from_below.wind is not None


def test_the_gas_of_several_sources_is_added(root: Path) -> None:
    result(root / "a", GOOD)
    result(root / "b", GOOD)
    with pytest.raises(InputError, match="several simulations"):
        import_gaden(root)
    both = import_gaden(root, results=[root / "a", root / "b"])
    one = import_gaden(root, results=root / "a")
    assert np.array_equal(both.concentration, 2 * one.concentration)  # type: ignore[operator]
    assert len(both.sources) == 2


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"folder": "none"}, "no such folder"),
        ({"save_step": 0}, "save_step"),
        ({"max_bytes": 100}, "allowed 100"),
        ({"wind": "wind/none"}, "holds no winds"),
        ({"results": "wind"}, "holds no results"),
        ({"occupancy": "none.csv"}, "cannot be read"),
    ],
)
def test_imports_that_cannot_be_are_refused(
    root: Path, monkeypatch: pytest.MonkeyPatch, parameters: dict[str, Any], word: str
) -> None:
    simulation(root)
    monkeypatch.chdir(root)
    with pytest.raises(InputError, match=word):
        import_gaden(**({"folder": root} | parameters))


def test_gaps_ambiguities_and_other_grids_are_refused(root: Path) -> None:
    with pytest.raises(InputError, match="holds no wind or gas"):
        import_gaden(root)
    simulation(root)
    path = result(root / "simulations" / "sim1", version_3(text(b"filaments"), wind=2), index=3)
    with pytest.raises(InputError, match="names wind 2"):
        import_gaden(root)
    result(path.parent, corrupted(GOOD, 44, struct.pack("<f", 0.25)), index=3)
    with pytest.raises(InputError, match="expected the grid's"):
        import_gaden(root)
    (path.parent / "iteration_1").unlink()
    with pytest.raises(InputError, match="number 1 of iteration is missing"):
        import_gaden(root)
    wrote(root / "other" / "wind_iteration_0", packed())
    with pytest.raises(InputError, match="several winds"):
        import_gaden(root)


def random_field(shape: tuple[int, int, int] = (5, 4, 3)) -> Field:
    rng = np.random.default_rng(5)
    solid = (rng.uniform(size=shape) < 0.2).astype(np.uint8)
    wind: NDArray[np.float32] = rng.normal(size=(4, *shape, 3)).astype(np.float32)
    gas = rng.gamma(1.0, 3.0, (4, *shape)).astype(np.float32)
    card = {"sources": [{"position": [0.5, 0.25, 0.125], "gas": "ethanol"}]}
    return Field(0.5 * np.arange(4), [0.1, -0.3, 2.0], [0.2] * 3, wind, gas, solid=solid, card=card)


def test_an_exported_field_comes_back(tmp_path: Path) -> None:
    field = random_field()
    export_gaden(field, tmp_path / "out")
    again = import_gaden(tmp_path / "out", save_step=0.5)
    for name in ("times", "wind", "concentration", "solid"):
        assert np.array_equal(getattr(again, name), getattr(field, name)), name
    np.testing.assert_allclose(again.origin, field.origin, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(again.spacing, field.spacing)
    assert again.card["sources"] == field.card["sources"]


def test_what_gaden_cannot_hold_is_not_exported(tmp_path: Path) -> None:
    field = random_field()
    oblong = Field(field.times, field.origin, [0.2, 0.2, 0.3], field.wind)
    with pytest.raises(InputError, match="cubes"):
        export_gaden(oblong, tmp_path / "a")
    grams = Field(field.times, field.origin, field.spacing, concentration=field.concentration, unit="g/m^3")
    with pytest.raises(InputError, match="ppm"):
        export_gaden(grams, tmp_path / "a")
    wrote(tmp_path / "b" / "file", b"")
    with pytest.raises(InputError, match="not empty"):
        export_gaden(field, tmp_path / "b")
