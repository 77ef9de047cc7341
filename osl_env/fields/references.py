"""Where a scenario's content names fields: the wind's, the plume's, and the arena's occupancy.

A relative path in a scenario's file is looked for beside the file first, then in the working folder. In a scenario's
hash a field stands for what is in its file, not for its name or place.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from osl_env.fields.library import field_path


def _renamed(content: dict[str, Any], rename: Callable[[str], str]) -> dict[str, Any]:
    """`content` of a scenario with every field's name put through `rename`; the parts changed are copies."""
    changed = dict(content)
    for part, key in (("wind", "field"), ("plume", "fields"), ("arena", "occupancy")):
        holder = changed.get(part)
        if not isinstance(holder, dict) or not holder.get(key):
            continue
        named = holder[key]
        if isinstance(named, dict) and isinstance(named.get("field"), str):
            named = named | {"field": rename(named["field"])}
        elif isinstance(named, str):
            named = rename(named)
        elif isinstance(named, list | tuple):
            named = [rename(name) if isinstance(name, str) else name for name in named]
        changed[part] = holder | {key: named}
    return changed


def found_beside(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """`content` of a scenario's file in `folder`, with the paths of fields that lie there."""
    return _renamed(content, lambda name: str(folder / name) if (folder / name).is_file() else name)


def by_content(content: dict[str, Any]) -> dict[str, Any]:
    """`content` of a scenario with digests of the fields' files instead of their names."""
    return _renamed(content, _digest)


def _digest(name: str) -> str:
    path = field_path(name)
    status = path.stat()
    return _digest_of(str(path.resolve()), status.st_mtime_ns, status.st_size)


@functools.lru_cache(maxsize=64)
def _digest_of(path: str, changed: int, size: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
