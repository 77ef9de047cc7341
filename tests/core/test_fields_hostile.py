"""Files from strangers: damaged, lying or hostile ones are refused in one line, within a bound of memory."""

from __future__ import annotations

import io
import json
import struct
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from osl_env.errors import InputError
from osl_env.fields import Field, read_field, save_field

Arrays = dict[str, Any]


@pytest.fixture
def small(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    wind, gas = rng.normal(size=(3, 4, 3, 2, 3)), rng.uniform(size=(3, 4, 3, 2))
    solid = np.zeros((4, 3, 2), np.uint8)
    field = Field([0.0, 1.0, 3.0], [0, 0, 0], [1, 1, 1], wind, gas, solid=solid, card={"title": "small"})
    save_field(field, tmp_path / "small.npz")
    return tmp_path / "small.npz"


def arrays_of(path: Path) -> Arrays:
    with np.load(path) as arrays:
        return {name: arrays[name] for name in arrays.files}


def write(path: Path, arrays: Arrays, method: int = zipfile.ZIP_DEFLATED) -> Path:
    """A zip of `arrays`; bytes are written as they are, an object array with pickle."""
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, array in arrays.items():
            content = array
            if not isinstance(array, bytes):
                stream = io.BytesIO()
                np.save(stream, array, allow_pickle=True)
                content = stream.getvalue()
            archive.writestr(name if name.endswith(".txt") else f"{name}.npy", content)
    return path


def headed(arrays: Arrays, **changes: Any) -> Arrays:
    header = json.loads(arrays["header"].tobytes()) | changes
    return arrays | {"header": np.frombuffer(json.dumps(header).encode(), np.uint8)}


def refused(path: Path, *words: str) -> None:
    with pytest.raises(InputError) as caught:
        read_field(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert "expected" in message or "must" in message
    for word in words:
        assert word in message, message


def test_the_small_file_is_good(small: Path, tmp_path: Path) -> None:
    assert read_field(small).n_frames == 3
    assert read_field(write(tmp_path / "again.npz", arrays_of(small))).n_frames == 3


def test_every_truncation_is_refused(small: Path, tmp_path: Path) -> None:
    content, cut = small.read_bytes(), tmp_path / "cut.npz"
    for length in [*range(0, len(content), 7), len(content) - 1]:
        cut.write_bytes(content[:length])
        refused(cut)


def test_damaged_bytes_give_an_error_in_one_line_or_a_valid_field(small: Path, tmp_path: Path) -> None:
    content, hurt = small.read_bytes(), tmp_path / "hurt.npz"
    rng = np.random.default_rng(1)
    read, messages = 0, []
    tracemalloc.start()
    for trial in range(800):
        damaged = bytearray(content)
        for at in rng.integers(0, len(content), 1 + trial % 4):
            damaged[at] ^= int(rng.integers(1, 256))
        hurt.write_bytes(damaged)
        try:
            read += read_field(hurt).n_frames == 3
        except InputError as error:
            messages.append(str(error))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert all(message.startswith(f"{hurt}: ") and "\n" not in message for message in messages)
    assert read < 200  # only bytes that mean nothing (names, dates, flags) can change unnoticed
    assert peak < 8e6


def test_damage_inside_an_array_is_caught_by_its_checksum(small: Path, tmp_path: Path) -> None:
    stored = write(tmp_path / "stored.npz", arrays_of(small), zipfile.ZIP_STORED)
    content = bytearray(stored.read_bytes())
    at = content.index(arrays_of(small)["wind"].tobytes()[:64]) + 20
    content[at] ^= 1
    stored.write_bytes(content)
    refused(stored, "damaged", "CRC")


HEADERS: list[tuple[dict[str, Any], str]] = [
    ({"version": 2}, "version = 2"),
    ({"format": "gaden"}, "format"),
    ({"shape": [3, 4, 3]}, "shape"),
    ({"shape": [3, 4, 3, 0]}, "at least one"),
    ({"shape": [3, -4, 3, 2]}, "at least one"),
    ({"shape": [3, 4, 3, 3]}, "expected"),
    ({"shape": [2**31, 2**31, 2**31, 2**31]}, "needs"),
    ({"shape": [10**4, 10**3, 10**3, 2]}, "needs"),
    ({"origin": [1e400, 0, 0]}, "origin"),
    ({"spacing": [0, 1, 1]}, "spacing"),
    ({"period": 0.5}, "period"),
    ({"unit": "x" * 100}, "unit"),
    ({"wind": None, "concentration": None}, "at least one"),
    ({"wind": {"bytes": 3, "components": 1, "step": 1, "mantissa": 1}}, "1, 2 or 4"),
    ({"wind": {"bytes": 2, "components": 9, "step": 1.0, "mantissa": 1}}, "less than or equal to 3"),
    ({"wind": {"bytes": 2, "components": 3, "step": 500.0, "mantissa": 23}}, "within 1000"),
    ({"solid": False}, "'solid' is unknown"),
    ({"card": {"sources": "here"}}, "sources"),
    ({"extra": 1}, "extra"),
]


@pytest.mark.parametrize(("change", "word"), HEADERS)
def test_lying_headers_are_refused(small: Path, tmp_path: Path, change: dict[str, Any], word: str) -> None:
    refused(write(tmp_path / "a.npz", headed(arrays_of(small), **change)), word)


def test_headers_that_are_not_json_objects_are_refused(small: Path, tmp_path: Path) -> None:
    arrays = arrays_of(small)
    for content in (b"", b"{", b"[]", b"\xff\xfe", b'{"version": NaN}', b"[" * 100_000, b"9" * 100_000):
        refused(write(tmp_path / "a.npz", arrays | {"header": np.frombuffer(content, np.uint8)}))
    refused(write(tmp_path / "a.npz", arrays | {"header": np.zeros(2**21, np.uint8)}), "header")
    refused(write(tmp_path / "a.npz", arrays | {"header": np.zeros((2, 2))}), "header")


def test_wrong_arrays_are_refused(small: Path, tmp_path: Path) -> None:
    arrays, path = arrays_of(small), tmp_path / "a.npz"
    refused(write(path, arrays | {"times": arrays["times"].astype(">f8")}), ">f8", "<f8")
    refused(write(path, arrays | {"times": arrays["times"].astype("c16")}), "<c16")
    refused(write(path, arrays | {"times": arrays["times"].astype("<i8")}), "<i8")
    refused(write(path, arrays | {"times": arrays["times"][::-1]}), "must come after")
    refused(write(path, arrays | {"times": np.array([0.0, np.nan, 2.0])}), "finite")
    refused(write(path, arrays | {"times": np.array([0, 1, None], object)}), "times")
    refused(write(path, arrays | {"wind": np.asfortranarray(arrays["wind"])}), "C order")
    refused(write(path, arrays | {"wind": arrays["wind"].ravel()}), "shape")
    refused(write(path, arrays | {"solid": arrays["solid"] + 9}), "solid")
    refused(write(path, {k: v for k, v in arrays.items() if k != "wind"}), "'wind' is missing")
    refused(write(path, {k: v for k, v in arrays.items() if k != "header"}), "'header' is missing")
    refused(write(path, arrays | {"more": np.zeros(3)}), "'more' is unknown")
    refused(write(path, arrays | {"notes.txt": b"hello"}), "notes.txt")
    refused(write(path, arrays | {f"n{k}": b"" for k in range(40)}), "members")
    refused(write(path, arrays, zipfile.ZIP_LZMA), "compression method")
    refused(write(path, arrays, zipfile.ZIP_BZIP2), "compression method")


def test_what_unpacks_to_no_number_is_refused(small: Path, tmp_path: Path) -> None:
    arrays = arrays_of(small)
    rng = np.random.default_rng(2)
    for _ in range(30):  # random bit patterns: infinities, NaN and numbers below 0 among them
        gas = rng.integers(0, 256, arrays["concentration"].shape).astype(np.uint8)
        packing = {"bytes": 4, "components": 1, "step": 0.0, "mantissa": 23}
        refused(write(tmp_path / "a.npz", headed(arrays | {"concentration": gas}, concentration=packing)))


def test_other_kinds_of_file_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    for content in (b"", b"PK", bytes(1000), b"hello" * 100, b"PK\x05\x06" + bytes(18)):
        path.write_bytes(content)
        refused(path)
    np.save(tmp_path / "b.npy", np.zeros(3))
    refused(tmp_path / "b.npy")
    refused(tmp_path, "not a file")
    refused(tmp_path / "none.npz", "no such file")


def bomb(path: Path, arrays: Arrays, cells: int) -> Path:
    """A file that holds `cells` zeros, and says so."""
    wind = np.zeros((1, 1, 1, cells, 1, 1), np.uint8)
    header = {"shape": [1, cells, 1, 1], "wind": {"bytes": 1, "components": 1, "step": 0.1, "mantissa": 23}}
    header |= {"concentration": None, "solid": False}
    kept = {"header": arrays["header"], "times": np.zeros(1), "wind": wind}
    return write(path, headed(kept, **header))


def test_zip_bombs_are_refused_within_a_bound_of_memory(small: Path, tmp_path: Path) -> None:
    path = bomb(tmp_path / "a.npz", arrays_of(small), 20_000_000)
    assert path.stat().st_size < 100_000
    tracemalloc.start()
    with pytest.raises(InputError, match="needs"):
        read_field(path, max_bytes=100_000_000)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def patched(path: Path, name: bytes, local: int, central: int, layout: str, value: int) -> None:
    """Overwrite a number of the member `name` in its local and its central zip header."""
    content = bytearray(path.read_bytes())
    first, last = content.index(name) - 30, content.rindex(name) - 46
    struct.pack_into(layout, content, first + local, value)
    struct.pack_into(layout, content, last + central, value)
    path.write_bytes(content)


def test_members_that_lie_about_their_size_are_refused(small: Path, tmp_path: Path) -> None:
    for size in (0, 1, 200, 2**31, 2**32 - 2):
        path = write(tmp_path / "a.npz", arrays_of(small))
        patched(path, b"wind.npy", 22, 24, "<I", size)
        tracemalloc.start()
        refused(path, "wind")
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
        tracemalloc.stop()


def test_a_directory_of_two_kinds_is_refused(small: Path, tmp_path: Path) -> None:
    content = small.read_bytes()
    end = content.rindex(b"PK\x05\x06")
    locator = struct.pack("<4sIQI", b"PK\x06\x07", 0, 0, 1)
    path = tmp_path / "a.npz"
    path.write_bytes(content[:end] + locator + content[end:])
    refused(path, "does not end")
    path.write_bytes(content + b"more")
    refused(path, "does not end")


def test_an_encrypted_member_is_refused(small: Path, tmp_path: Path) -> None:
    path = write(tmp_path / "a.npz", arrays_of(small))
    patched(path, b"times.npy", 6, 8, "<H", 1)
    refused(path, "damaged")


def test_damage_under_a_valid_checksum_gives_an_error_or_a_valid_field(small: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(small) as archive:
        members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    rng = np.random.default_rng(3)
    messages = []
    for trial in range(400):
        name = sorted(members)[trial % len(members)]
        content = bytearray(members[name])
        at = int(rng.integers(0, len(content) if trial % 3 else 128))  # often in the array's own header
        content[at : at + trial % 4] = rng.bytes(1 + trial % 5)
        path = write(tmp_path / "a.npz", members | {name: bytes(content)})
        try:
            assert read_field(path).n_frames == 3
        except InputError as error:
            messages.append(str(error))
    assert len(messages) > 200
    assert all("\n" not in message and len(message) < 1000 for message in messages)
