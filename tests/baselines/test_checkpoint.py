"""Checkpoint folders: what is written is read, and what is wrong is refused in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from checkpoints import random_checkpoint
from worlds import small

from baselines.learned import checkpoint as module
from baselines.learned.checkpoint import HEADER_FILE, MODEL_FILE, Checkpoint
from osl_env import InputError

TASK = small()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return random_checkpoint(TASK).write(tmp_path / "random")


def refusal(folder: Path) -> str:
    with pytest.raises(InputError) as caught:
        Checkpoint.load(folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def change(folder: Path, **keys: Any) -> None:
    path = folder / HEADER_FILE
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | keys))


def test_what_is_written_is_read(folder: Path) -> None:
    written, read = random_checkpoint(TASK), Checkpoint.load(folder)
    assert read.header.model_copy(update={"sha256": ""}) == written.header
    assert read.arrays.keys() == written.arrays.keys()
    assert all(np.array_equal(read.arrays[name], array) for name, array in written.arrays.items())
    assert sorted(path.name for path in folder.iterdir()) == [HEADER_FILE, MODEL_FILE]


def test_writing_is_reproducible_to_the_byte(folder: Path, tmp_path: Path) -> None:
    again = random_checkpoint(TASK).write(tmp_path / "again")
    for name in (HEADER_FILE, MODEL_FILE):
        assert (again / name).read_bytes() == (folder / name).read_bytes()


def test_a_new_checkpoint_takes_the_place_of_the_old_one(folder: Path) -> None:
    random_checkpoint(TASK, seed=2).write(folder)
    assert Checkpoint.load(folder).arrays["action.bias"][0] == random_checkpoint(TASK, seed=2).arrays["action.bias"][0]
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]


@pytest.mark.parametrize("at", [1, 2])
def test_a_kill_while_writing_loses_nothing(folder: Path, at: int, monkeypatch: pytest.MonkeyPatch) -> None:
    renames = 0

    def rename(self: Path, target: Path) -> Path:
        nonlocal renames
        renames += 1
        if renames == at:
            raise KeyboardInterrupt
        return self.replace(target)

    before = Checkpoint.load(folder).header
    with monkeypatch.context() as patched:
        patched.setattr(Path, "rename", rename)
        with pytest.raises(KeyboardInterrupt):
            random_checkpoint(TASK, seed=2).write(folder)
    assert Checkpoint.load(folder).header == before
    random_checkpoint(TASK, seed=3).write(folder)
    assert Checkpoint.load(folder).header != before


@pytest.mark.parametrize("kept", [0, 5, 100, -1])
def test_a_truncated_file_is_refused(folder: Path, kept: int) -> None:
    path = folder / MODEL_FILE
    path.write_bytes(path.read_bytes()[:kept])
    assert "truncated" in refusal(folder)


def test_altered_weights_are_refused(folder: Path) -> None:
    path = folder / MODEL_FILE
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert "SHA-256" in refusal(folder)


def test_the_files_of_two_checkpoints_are_refused(folder: Path, tmp_path: Path) -> None:
    other = random_checkpoint(TASK, seed=2).write(tmp_path / "other")
    (folder / MODEL_FILE).write_bytes((other / MODEL_FILE).read_bytes())
    assert "not of the same checkpoint" in refusal(folder)


@pytest.mark.parametrize("name", [HEADER_FILE, MODEL_FILE])
def test_a_missing_file_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    assert str(folder / name) in refusal(folder)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    assert "no such checkpoint" in refusal(tmp_path / "nowhere")


def test_a_pickle_is_not_read(folder: Path) -> None:
    (folder / MODEL_FILE).write_bytes(b"\x80\x04cbuiltins\nprint\n(S'loaded'\ntR.")
    assert "not a safetensors file" in refusal(folder)


def test_a_huge_file_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_MODEL_BYTES", 100)
    assert "larger than 100 bytes" in refusal(folder)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"colour": "red"}, "unknown key 'colour'"),
        ({"format": 2}, "format = 2"),
        ({"agent": "swimmer"}, "agent = 'swimmer'"),
        ({"name": "../elsewhere"}, "name = '../elsewhere'"),
        ({"architecture": {"kind": "transformer"}}, "unknown architecture, allowed are mlp, lstm, team"),
        ({"max_uavs": 0}, "max_uavs = 0"),
        ({"sha256": "abc"}, "sha256 = 'abc'"),
        ({"sha256": ""}, "says none"),
    ],
)
def test_bad_headers_are_refused(folder: Path, keys: dict[str, Any], message: str) -> None:
    change(folder, **keys)
    text = refusal(folder)
    assert message in text
    assert str(folder) in text


@pytest.mark.parametrize("key", ["name", "agent", "algorithm", "architecture", "observation", "max_uavs", "scenario"])
def test_a_missing_key_is_named(folder: Path, key: str) -> None:
    path = folder / HEADER_FILE
    header = yaml.safe_load(path.read_text())
    del header[key]
    path.write_text(yaml.safe_dump(header))
    assert refusal(folder) == f"{path}: key {key!r} is missing"


@pytest.mark.parametrize(
    ("array", "message"),
    [(np.array([1.0, np.nan], np.float32), "finite"), (np.ones(2), "float32, not float64")],
)
def test_weights_must_be_finite_float32(array: Any, message: str, tmp_path: Path) -> None:
    whole = random_checkpoint(TASK)
    with pytest.raises(InputError, match=message):
        replace(whole, arrays={**whole.arrays, "action.bias": array}).write(tmp_path / "bad")
    assert not (tmp_path / "bad").exists()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        random_checkpoint(TASK).write(tmp_path / "file" / "inside")
