"""Where finished episodes are kept, so that a stopped or repeated experiment runs only what is missing.

One append-only JSON-lines file for each (scenario, policy, parameters, code): any change of these is another file, so a
stored episode is never taken for one of other code. "Code" is the version and a digest of the sources of `osl_env` and
`baselines` and of the policy's own module.
A line that a crash cut off is dropped at the next opening; an episode counts once its line is complete.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import os
from collections.abc import Iterable
from io import FileIO
from pathlib import Path
from typing import Any

import baselines
import osl_env
from baselines import Policy
from osl_env.errors import InputError
from osl_env.record import EpisodeRecord
from osl_env.scenario import Scenario
from training.records import make_folder


@functools.cache
def digest_of_sources() -> str:
    """SHA-256 over the sources of `osl_env` and `baselines`."""
    digest = hashlib.sha256()
    for package in (osl_env, baselines):
        folder = Path(str(package.__file__)).parent
        for path in sorted(folder.rglob("*.py")):
            digest.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _digest_of_module(policy: Policy) -> str:
    if type(policy).__module__.startswith("baselines."):
        return ""  # counted above
    try:
        source = Path(inspect.getfile(type(policy))).read_bytes()
    except (OSError, TypeError):  # a class typed at a prompt has no file
        return ""
    return hashlib.sha256(source).hexdigest()


def parameters_of(policy: Policy) -> dict[str, Any]:
    """The parameters of `policy` as strict JSON values: infinities as text."""
    values: dict[str, Any] = json.loads(json.dumps(policy.model_dump(mode="json")), parse_constant=str)
    return values


def cell_key(scenario: Scenario, policy: Policy) -> str:
    """Name of everything that an episode depends on but its seed: readable beginning, digest at the end."""
    identity = {
        "scenario": scenario.hash,
        "policy": policy.name,
        "parameters": parameters_of(policy),
        "code": [digest_of_sources(), _digest_of_module(policy)],
    }
    digest = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
    return f"{scenario.name}_{policy.name}_{digest[:16]}".replace(os.sep, "-")


class Store:
    """Episode records in `folder`, which is made when it is checked or written."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def check(self) -> None:
        """Raise InputError now if nothing could be kept later."""
        make_folder(self.folder)
        if not os.access(self.folder, os.W_OK):
            raise InputError(f"{self.folder}: cannot be written")

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.jsonl"

    def finished(self, key: str) -> dict[int, EpisodeRecord]:
        """Seed -> record of what is kept under `key`. Raises InputError for a file that is not a store's."""
        path = self._path(key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from None
        complete, _, _ = content.rpartition(b"\n")
        records = {}
        for number, line in enumerate(complete.splitlines(), start=1):
            try:
                record = EpisodeRecord.from_dict(json.loads(line))
            except ValueError as error:
                raise InputError(f"{path}: line {number} is not an episode record ({error})") from None
            records[record.seed] = record
        return records

    def add(self, key: str, records: Iterable[EpisodeRecord]) -> None:
        """Keep `records` under `key`, on the disk when this returns. Raises InputError if that is impossible."""
        lines = "".join(json.dumps(record.to_dict(), allow_nan=False) + "\n" for record in records).encode()
        path = self._path(key)
        make_folder(self.folder)
        try:
            with path.open("a+b", buffering=0) as file:
                _drop_cut_off_line(file)
                file.write(lines)  # one call: a second process or Ctrl-C cannot come between
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def _drop_cut_off_line(file: FileIO) -> None:
    file.seek(0)
    content = file.readall()
    if not content.endswith(b"\n"):
        file.truncate(content.rfind(b"\n") + 1)
