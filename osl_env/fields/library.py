"""The fields that ship with the package, and loading one by name or path, once for all who use it."""

from __future__ import annotations

import difflib
import os
from collections import deque
from pathlib import Path
from weakref import WeakValueDictionary

from osl_env.configuration import config_folder
from osl_env.errors import InputError
from osl_env.fields.field import Field
from osl_env.fields.storage import read_field

_loaded: WeakValueDictionary[tuple[str, int, int], Field] = WeakValueDictionary()
_recent: deque[Field] = deque(maxlen=2)  # kept between a scenario's check and its first world


def field_names() -> list[str]:
    """The names of the shipped fields."""
    return sorted(path.stem for path in (config_folder() / "fields").glob("*.npz"))


def load_field(name: str | Path) -> Field:
    """The field that `name` means: a shipped field's name, or the path of a field's .npz file.

    Loaded once: as long as the file is unchanged and the field in use, all get the same object. Raises InputError for
    an unknown name or a bad file.
    """
    path = field_path(str(name))
    try:
        status = path.stat()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a field's .npz file") from None
    key = (str(path.resolve()), status.st_mtime_ns, status.st_size)
    field = _loaded.get(key)
    if field is None:
        field = _loaded[key] = read_field(path)
    _recent.append(field)
    return field


def field_path(name: str) -> Path:
    """The file of the shipped field `name`, or at the path `name`. Raises InputError if it is neither."""
    if "\x00" not in name:
        if "/" not in name and "\\" not in name and name in field_names():
            return config_folder() / "fields" / f"{name}.npz"
        path = Path(name)
        if path.suffix == ".npz" or os.path.isfile(path):  # unlike Path's, never raises
            return path
    names = field_names()
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    shipped = ", ".join(names) or "none shipped"
    raise InputError(f"unknown field {name!r:.80}: {hint}allowed are {shipped}, or the path of an .npz file")
