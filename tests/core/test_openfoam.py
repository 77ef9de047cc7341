"""OpenFOAM cases as fields, in text and binary; and the fields that ship, which come from such cases."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from osl_env import load_scenario
from osl_env.errors import InputError
from osl_env.fields import field_names, load_field
from osl_env.fields.openfoam import import_openfoam
from osl_env.geometry import SOLID

SHAPE, CELL = (6, 4, 2), 0.5
HOLE = (2, 1, 0)  # the cell that is cut out
LAYOUTS = tuple(f"arena-4x6-{number}-{layout}" for number in (5, 10) for layout in "bc")
ARENAS = ("arena-4x6-0", "arena-4x6-5", "arena-4x6-10", "arena-30x40", *LAYOUTS)


def _list(values: np.ndarray, binary: bool) -> bytes:
    """A list of vectors, scalars or integers as OpenFOAM writes it."""
    if binary:
        kind = "<i4" if values.dtype.kind == "i" else "<f8"
        return b"%d\n(" % len(values) + values.astype(kind).tobytes() + b")\n"
    rows = [f"({' '.join(f'{x:.8g}' for x in row)})" if values.ndim == 2 else f"{row:.8g}" for row in values]
    return f"{len(values)}\n(\n".encode() + "\n".join(rows).encode() + b"\n)\n"


def _write(path: Path, kind: str, body: bytes, binary: bool) -> None:
    form = 'format binary;\n    arch "LSB;label=32;scalar=64"' if binary else "format ascii"
    path.parent.mkdir(parents=True, exist_ok=True)
    head = (
        f"/*--- OpenFOAM (a banner) ---*/\nFoamFile\n{{\n    {form};\n    class {kind};\n    object {path.name};\n}}\n"
    )
    path.write_bytes(head.encode() + b"// * * * //\n\n" + body + b"\n// *** //\n")


def _mesh(edges: list[np.ndarray], hole: tuple[int, int, int] | None) -> tuple[np.ndarray, ...]:
    """Points, faces (n, 4), owner, neighbour and the cells' places of a mesh of boxes between `edges`."""
    counts = [len(edge) - 1 for edge in edges]
    points = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(*[len(edge) for edge in edges])
    places = [place for place in np.ndindex(*counts) if place != hole]
    cell = {place: k for k, place in enumerate(places)}
    inner, outer = [], []
    for place in np.ndindex(*[n + 1 for n in counts]):
        for axis in range(3):
            before = tuple(x - (k == axis) for k, x in enumerate(place))
            sides = [cell[side] for side in (before, place) if side in cell]
            across = [k for k in range(3) if k != axis]
            if not sides or any(place[k] >= counts[k] for k in across):
                continue
            i, j = (np.eye(3, dtype=int)[k] for k in across)
            corners = [int(number[tuple(place + step)]) for step in (0 * i, i, i + j, j)]
            (inner if len(sides) == 2 else outer).append((corners, sides))
    faces = np.array([corners for corners, _ in inner + outer])
    owner = np.array([sides[0] for _, sides in inner + outer])
    neighbour = np.array([sides[1] for _, sides in inner])
    return points, faces, owner, neighbour, np.array(places)


def _wind(centres: np.ndarray, time: float) -> np.ndarray:
    """A velocity that is linear in space and time."""
    x, y, z = centres.T
    return np.stack([1.0 + 0.1 * x + time, 0.2 * y, -0.1 * z], axis=1)


def _write_case(
    folder: Path, binary: bool, edges: list[np.ndarray] | None = None, hole: tuple[int, int, int] | None = HOLE
) -> tuple[np.ndarray, np.ndarray]:
    """A case with times 0, 0.5 and 1.5; its cells' places and centres."""
    edges = edges or [CELL * np.arange(n + 1) for n in SHAPE]
    points, faces, owner, neighbour, places = _mesh(edges, hole)
    mesh = folder / "constant" / "polyMesh"
    _write(mesh / "points", "vectorField", _list(points, binary), binary)
    _write(mesh / "owner", "labelList", _list(owner, binary), binary)
    _write(mesh / "neighbour", "labelList", _list(neighbour, binary), binary)
    if binary:
        lists = _list(4 * np.arange(len(faces) + 1), True) + _list(faces.reshape(-1), True)
        _write(mesh / "faces", "faceCompactList", lists, True)
    else:
        text = "\n".join(f"4({' '.join(map(str, face))})" for face in faces)
        _write(mesh / "faces", "faceList", f"{len(faces)}\n(\n{text}\n)\n".encode(), False)
    middles = [0.5 * (edge[1:] + edge[:-1]) for edge in edges]
    centres = np.stack([middle[place] for middle, place in zip(middles, places.T, strict=True)], axis=1)
    start = b"dimensions [0 1 -1 0 0 0 0];\ninternalField uniform (1 0 0);\nboundaryField { }\n"
    _write(folder / "0" / "U", "volVectorField", start, binary)
    for name in ("0.5", "1.5"):
        head = b"dimensions [0 1 -1 0 0 0 0];\ninternalField nonuniform List<vector>\n"
        body = _list(_wind(centres, float(name)), binary) + b";\nboundaryField\n{\n}\n"
        _write(folder / name / "U", "volVectorField", head + body, binary)
        head = b"dimensions [1 -3 0 0 0 0 0];\ninternalField nonuniform List<scalar>\n"
        _write(folder / name / "C", "volScalarField", head + _list(centres[:, 0], binary) + b";\n", binary)
    return places, centres


@pytest.mark.parametrize("binary", [False, True])
def test_regular_mesh_is_taken_over_cell_by_cell(tmp_path: Path, binary: bool) -> None:
    places, centres = _write_case(tmp_path, binary)
    field = import_openfoam(tmp_path)
    assert field.shape == SHAPE
    assert field.wind is not None
    assert field.concentration is not None
    np.testing.assert_allclose(field.times, [0.5, 1.5])  # the initial state is left out
    np.testing.assert_allclose(field.low, 0.0, atol=1e-12)
    np.testing.assert_allclose(field.spacing, CELL)
    i, j, k = places.T
    for frame, time in enumerate(field.times):
        np.testing.assert_allclose(field.wind[frame, i, j, k], _wind(centres, time), rtol=1e-6)
    np.testing.assert_allclose(field.concentration[0, i, j, k], centres[:, 0], rtol=1e-6)
    assert field.unit == "kg/m^3"
    assert field.solid is not None
    assert field.solid[HOLE] == SOLID
    assert field.solid.sum() == SOLID
    assert np.all(field.wind[:, *HOLE] == 0.0)


def test_text_and_binary_are_the_same_field(tmp_path: Path) -> None:
    _write_case(tmp_path / "text", False)
    _write_case(tmp_path / "binary", True)
    text, binary = import_openfoam(tmp_path / "text"), import_openfoam(tmp_path / "binary")
    np.testing.assert_allclose(text.wind, binary.wind, rtol=1e-6)
    np.testing.assert_array_equal(text.solid, binary.solid)


def test_times_can_be_chosen(tmp_path: Path) -> None:
    _write_case(tmp_path, True)
    assert import_openfoam(tmp_path, start=0.0, scalar="").times.tolist() == [0.0, 0.5, 1.5]
    first = import_openfoam(tmp_path, start=0.0, stop=0.2, scalar="")
    assert first.wind is not None
    assert first.concentration is None
    np.testing.assert_allclose(first.wind[0][first.free], [[1.0, 0.0, 0.0]] * int(first.free.sum()))


GRADED = [np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.5, 2.0]), np.linspace(0, 1, 6), np.linspace(0, 1, 6)]


def test_graded_mesh_needs_a_spacing(tmp_path: Path) -> None:
    _write_case(tmp_path, True, GRADED, hole=None)
    with pytest.raises(InputError, match="not a regular grid"):
        import_openfoam(tmp_path)


def test_linear_resampling_is_exact_for_a_linear_field(tmp_path: Path) -> None:
    _, centres = _write_case(tmp_path, False, GRADED, hole=None)
    field = import_openfoam(tmp_path, spacing=0.1, method="linear")
    assert field.shape == (20, 10, 10)
    assert field.wind is not None
    assert field.solid is None
    grid = np.stack(np.meshgrid(*[field.centres(axis) for axis in ("x", "y", "z")], indexing="ij"), axis=-1)
    inside = np.all((grid >= centres.min(axis=0)) & (grid <= centres.max(axis=0)), axis=-1)
    np.testing.assert_allclose(field.wind[0][inside], _wind(grid[inside], 0.5), atol=1e-6)


def test_nearest_resampling_takes_the_cell_that_holds_the_place(tmp_path: Path) -> None:
    _, centres = _write_case(tmp_path, True, GRADED, hole=None)
    field = import_openfoam(tmp_path, spacing=(0.05, 0.2, 0.2))
    assert field.concentration is not None
    at = np.searchsorted(GRADED[0], field.centres("x")) - 1
    middles = np.unique(np.round(centres[:, 0], 9))
    np.testing.assert_allclose(field.concentration[0, :, 0, 0], middles[at], rtol=1e-6)


def test_resampling_keeps_the_hole_solid(tmp_path: Path) -> None:
    _write_case(tmp_path, True)
    field = import_openfoam(tmp_path, spacing=0.25)
    assert field.solid is not None
    assert field.solid.sum() == 8 * SOLID


def _damaged(path: Path, how: str) -> None:
    content = path.read_bytes()
    if how == "cut":
        path.write_bytes(content[: len(content) * 2 // 3])
    elif how == "garbage":
        path.write_bytes(b"\x00\x01 garbage" * 50)
    elif how == "gone":
        path.unlink()
    elif how == "packed":
        path.rename(path.with_name(path.name + ".gz"))


DAMAGES = {
    "cut": "cut off|damaged|expected a list",
    "garbage": "no FoamFile header",
    "gone": "no such file",
    "packed": "is compressed",
}


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize(
    ("file", "how"),
    [(f"constant/polyMesh/{name}", how) for name in ("points", "faces", "neighbour") for how in DAMAGES]
    + [(name, how) for name in ("0.5/U", "1.5/U") for how in ("cut", "garbage", "packed")],
)
def test_damaged_files_are_refused(tmp_path: Path, file: str, how: str, binary: bool) -> None:
    _write_case(tmp_path, binary)
    _damaged(tmp_path / file, how)
    with pytest.raises(InputError, match=DAMAGES[how]) as error:
        import_openfoam(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("file", ["0.5/U", "constant/polyMesh/points"])
def test_a_length_that_the_file_cannot_hold_is_refused(tmp_path: Path, binary: bool, file: str) -> None:
    _write_case(tmp_path, binary)
    path = tmp_path / file
    path.write_bytes(re.sub(rb"\n\d+\n\(", b"\n2000000000\n(", path.read_bytes(), count=1))
    with pytest.raises(InputError, match=r"the mesh has 47 cells|cut off or damaged"):
        import_openfoam(tmp_path)


def test_values_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    _write_case(tmp_path, False)
    path = tmp_path / "0.5" / "U"
    path.write_bytes(path.read_bytes().replace(b"(1.525 ", b"(nan ", 1))
    with pytest.raises(InputError, match="not finite"):
        import_openfoam(tmp_path)


def test_what_is_not_a_case_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not an OpenFOAM case"):
        import_openfoam(tmp_path)
    (tmp_path / "processor0").mkdir()
    with pytest.raises(InputError, match="reconstructPar"):
        import_openfoam(tmp_path)
    (tmp_path / "constant" / "polyMesh").mkdir(parents=True)
    with pytest.raises(InputError, match="no time has a velocity 'U'"):
        import_openfoam(tmp_path)


def test_two_folders_of_one_time_are_refused(tmp_path: Path) -> None:
    _write_case(tmp_path, True)
    (tmp_path / "0.50").mkdir()
    (tmp_path / "0.50" / "U").write_bytes((tmp_path / "0.5" / "U").read_bytes())
    with pytest.raises(InputError, match="times do not increase"):
        import_openfoam(tmp_path)


def test_memory_is_bounded(tmp_path: Path) -> None:
    _write_case(tmp_path, True)
    with pytest.raises(InputError, match="fit max_bytes"):
        import_openfoam(tmp_path, spacing=1e-4)


# --- the fields that ship


def test_all_arenas_ship() -> None:
    assert set(ARENAS) <= set(field_names())


@pytest.mark.parametrize("name", ARENAS)
def test_shipped_field_fits_its_preset(name: str) -> None:
    """Its solid cells are the preset's obstacles, and the air in them stands still."""
    scenario, field = load_scenario(name), load_field(name)
    assert field.wind is not None
    assert field.covers(scenario.arena.size)
    centres = np.stack(np.meshgrid(*[field.centres(axis) for axis in ("x", "y", "z")], indexing="ij"), axis=-1)
    solid = np.zeros(field.shape, bool)
    for low, high in zip(*np.split(scenario.arena.geometry.boxes, 2, axis=1), strict=True):
        solid |= np.all((centres > low) & (centres < high), axis=-1)
    np.testing.assert_array_equal(~field.free, solid)
    assert np.all(field.wind[:, solid] == 0.0)
    assert np.all(field.wind[..., 2] == 0.0)


@pytest.mark.parametrize("name", ARENAS)
def test_shipped_field_is_the_flow_that_its_card_says(name: str) -> None:
    """Mean and rms, recomputed over the card's region; rms of the cross-stream wind in the wakes 0.05 to 0.3 m/s."""
    field = load_field(name)
    assert field.wind is not None
    numbers = field.card["statistics"]
    mean = field.wind.mean(axis=0)
    assert abs(mean[0, :, 0, 0].mean() - 0.5) < 0.01  # m/s: the first cells stand next to the inlet
    flux = (field.wind[..., 0].mean(axis=0) * field.free).sum(axis=(1, 2))
    # what comes in goes out. Velocities are those of the cells' centres: at the front of a box the flow turns within a
    # cell, and a column errs by some per cent, its neighbours the other way
    assert np.abs(flux / flux[0] - 1.0).max() < 0.035
    assert np.abs(np.convolve(flux / flux[0] - 1.0, np.ones(4) / 4, "valid")).max() < 0.01
    if "wakes" in numbers:
        assert 0.05 < numbers["wakes"]["rms_m_s"][1] < 0.3
        # Strouhal number 0.2: boxes 0.5 to 0.3 m wide in air of 0.4 (in a wake) to 0.7 m/s (in a gap)
        assert 0.16 <= numbers["wakes"]["shedding_hz"] <= 0.47
    rms = np.sqrt(((field.wind - mean) ** 2).mean(axis=0)[field.free].mean(axis=0))
    np.testing.assert_allclose(rms[:2], numbers["wind"]["rms_m_s"][:2], rtol=0.02)


@pytest.mark.parametrize("name", ARENAS)
def test_shipped_field_loops_without_a_seam(name: str) -> None:
    """Between the last frame and the first the wind changes no more than it does between others."""
    field = load_field(name)
    assert field.wind is not None
    assert field.period == pytest.approx(field.n_frames * (field.times[1] - field.times[0]))
    changes = np.array([np.sqrt(((b - a) ** 2).mean()) for a, b in zip(field.wind, np.roll(field.wind, -1, 0))])  # noqa: B905
    assert changes[-1] < 1.5 * np.median(changes)
    energy = ((field.wind - field.wind.mean(axis=0)) ** 2).mean(axis=(1, 2, 3, 4))
    seam = round(0.08 * field.n_frames)  # the ends are blended over up to 8 % of the loop
    stretches = energy[seam:][: (len(energy) - seam) // seam * seam].reshape(-1, seam).mean(axis=1)
    assert energy[:seam].mean() > 0.8 * stretches.min()  # the blend is no calmer than the calmest other stretch
