"""Checkpoints: a trained network and everything that is needed to fly it, as a folder of two files.

`model.safetensors` holds the weights (float32; a plain table of numbers, nothing in it is executed), `checkpoint.yaml`
what they mean: architecture, definition of observation and action, scenario, training command and scores, and the
SHA-256 of the weights, so that neither file can be exchanged unnoticed.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field, ValidationError, field_validator
from safetensors import SafetensorError
from safetensors.numpy import load as safetensors_loads
from safetensors.numpy import save as safetensors_saves

from osl_env.configuration import MAX_CONFIG_BYTES, config_folder, read_yaml
from osl_env.errors import InputError
from osl_env.parameters import Parameters, one_line, quantity

MODEL_FILE, HEADER_FILE = "model.safetensors", "checkpoint.yaml"
MAX_MODEL_BYTES = 1 << 30
ARCHITECTURES = ("mlp", "lstm", "team")
Agent = Literal["hop", "waypoint", "velocity", "setpoint", "course", "search"]
Float32Array = NDArray[np.float32]


class ObservationDefinition(Parameters):
    """What the network is fed: the features in their order, how many numbers they are, and their hash."""

    features: tuple[dict[str, Any], ...] = ()
    size: int = quantity(..., "", ge=1)
    hash: str = ""


class ScenarioMark(Parameters):
    """Which scenario the network was trained for."""

    name: str
    hash: str


class CheckpointHeader(Parameters):
    """The content of `checkpoint.yaml`."""

    format: Literal[1] = 1
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")
    agent: Agent
    algorithm: str
    architecture: dict[str, Any]  # `kind` and the sizes that the kind needs
    observation: ObservationDefinition
    action: dict[str, Any] = Field(default_factory=dict)  # what the outputs mean, by the kind of agent
    max_uavs: int = quantity(..., "", ge=1)
    scenario: ScenarioMark
    training: dict[str, Any] = Field(default_factory=dict)  # command, config, seed, steps, seconds, versions
    scores: dict[str, Any] = Field(default_factory=dict)
    sha256: str = Field(default="", pattern=r"^([0-9a-f]{64})?$")  # of model.safetensors; `write` fills it in

    @field_validator("architecture")
    @classmethod
    def _known_kind(cls, architecture: dict[str, Any]) -> dict[str, Any]:
        kind = architecture.get("kind")
        if kind not in ARCHITECTURES:
            raise ValueError(f"kind = {kind!r}: unknown architecture, allowed are {', '.join(ARCHITECTURES)}")
        return architecture


@dataclass(frozen=True)
class Checkpoint:
    """A header and the weights, name -> float32 array."""

    header: CheckpointHeader
    arrays: Mapping[str, Float32Array]

    @classmethod
    def load(cls, folder: str | Path) -> Checkpoint:
        """The checkpoint in `folder`. Raises InputError in one line for a missing, truncated or altered file."""
        folder = _present(Path(folder))
        path = folder / MODEL_FILE
        header = _read_header(folder / HEADER_FILE)
        content = _read_model(path)
        found = hashlib.sha256(content).hexdigest()
        try:
            arrays = safetensors_loads(content)
        except (SafetensorError, KeyError, ValueError) as error:
            raise InputError(f"{path}: is truncated, or not a safetensors file ({error})") from None
        if found != header.sha256:
            raise InputError(
                f"{path}: has the SHA-256 {found[:12]}.., but {HEADER_FILE} says {header.sha256[:12] or 'none'}..: the"
                " two files are not of the same checkpoint"
            )
        _check_arrays(arrays, path)
        return cls(header, arrays)

    @property
    def digest(self) -> str:
        """SHA-256 of all that decides how the checkpoint flies: weights, architecture, observation and action."""
        flown = self.header.model_dump(
            mode="json", include={"agent", "architecture", "observation", "action", "sha256"}
        )
        return hashlib.sha256(json.dumps(flown, sort_keys=True).encode()).hexdigest()

    def write(self, folder: str | Path) -> Path:
        """Write the two files so that a kill at any moment leaves the old checkpoint or the new one; the folder.

        Raises InputError if the weights are not finite float32 arrays, or the folder cannot be written.
        """
        folder = Path(folder)
        _check_arrays(self.arrays, folder / MODEL_FILE)
        content = safetensors_saves({name: np.ascontiguousarray(array) for name, array in self.arrays.items()})
        fresh = folder.with_name(f".{folder.name}.{os.getpid()}")
        sealed = replace(self, header=self.header.model_copy(update={"sha256": hashlib.sha256(content).hexdigest()}))
        try:
            fresh.mkdir(parents=True, exist_ok=True)
            (fresh / MODEL_FILE).write_bytes(content)
            (fresh / HEADER_FILE).write_text(sealed.header_text(), encoding="utf-8")
            _exchange(fresh, folder)
        except OSError as error:
            raise InputError(f"{folder}: cannot be written ({error.strerror})") from None
        return folder

    def header_text(self) -> str:
        """The header as YAML, in the order of the fields, without what is None."""
        content = self.header.model_dump(mode="json", exclude_none=True)
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=120)
        if len(text.encode()) > MAX_CONFIG_BYTES:
            raise InputError(f"checkpoint {self.header.name}: its header has over {MAX_CONFIG_BYTES} bytes")
        return text


def shipped_folder(name: str) -> Path:
    """Where the shipped checkpoint `name` lies, whether it exists or not."""
    return config_folder() / "checkpoints" / name


def _aside(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.previous")


def _exchange(fresh: Path, folder: Path) -> None:
    """Put `fresh` in the place of `folder`. Between the two renames `_present` finds the one before."""
    aside = _aside(folder)
    if folder.exists():
        shutil.rmtree(aside, ignore_errors=True)
        folder.rename(aside)
    fresh.rename(folder)
    shutil.rmtree(aside, ignore_errors=True)


def _present(folder: Path) -> Path:
    """`folder`, or what a killed `write` has put aside. Raises InputError if there is neither."""
    if folder.is_dir():
        return folder
    if _aside(folder).is_dir():
        return _aside(folder)
    raise InputError(f"{folder}: no such checkpoint: must be a folder with {HEADER_FILE} and {MODEL_FILE}")


def _read_header(path: Path) -> CheckpointHeader:
    try:
        return CheckpointHeader.model_validate(read_yaml(path))
    except ValidationError as error:
        raise one_line(error, path) from None


def _read_model(path: Path) -> bytes:
    try:
        if path.stat().st_size > MAX_MODEL_BYTES:
            raise InputError(f"{path}: larger than {MAX_MODEL_BYTES} bytes, so it is not a checkpoint of a policy")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _check_arrays(arrays: Mapping[str, Any], where: Path) -> None:
    for name, array in arrays.items():
        if array.dtype != np.float32:
            raise InputError(f"{where}: array {name!r}: must be of type float32, not {array.dtype}")
        if not np.isfinite(array).all():
            raise InputError(f"{where}: array {name!r}: must hold finite numbers")
