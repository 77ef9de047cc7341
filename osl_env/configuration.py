"""Where the shipped configurations live, and how a YAML file is read safely."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from osl_env.errors import InputError

_PACKAGE = Path(__file__).resolve().parent
MAX_CONFIG_BYTES = 1_000_000


def config_folder() -> Path:
    """The folder of the shipped configurations: `osl_env/configs` in the wheel, `configs` in a source tree."""
    inside = _PACKAGE / "configs"
    return inside if inside.is_dir() else _PACKAGE.parent / "configs"


def read_yaml(path: Path) -> dict[str, Any]:
    """The mapping in the YAML file at `path`, loaded safely. Raises InputError if there is none."""
    try:
        if path.stat().st_size > MAX_CONFIG_BYTES:
            raise InputError(f"{path}: larger than {MAX_CONFIG_BYTES} bytes, so it is not a configuration")
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not UTF-8 text") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f", line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{place}: is not YAML ({getattr(error, 'problem', None) or 'malformed'})") from None
    if not isinstance(content, dict) or not all(isinstance(key, str) for key in content):
        raise InputError(f"{path}: must hold a mapping of keys to values, not {type(content).__name__}")
    return content


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """`base` with `changes` laid over it, mapping by mapping; a dotted key (`radio.radius`) reaches inside.

    Another `kind` begins with that model's defaults, whether it comes in a mapping or as a dotted key.
    """
    result = dict(base)
    for key, value in sorted(changes.items(), key=lambda entry: not entry[0].endswith(".kind")):
        head, _, rest = key.partition(".")
        inner = result.get(head)
        if rest == "kind" and isinstance(inner, dict) and _other_kind(inner, {rest: value}):
            result[head] = {rest: value}
        elif rest:
            result[head] = merged(inner if isinstance(inner, dict) else {}, {rest: value})
        elif isinstance(inner, dict) and isinstance(value, dict):
            result[head] = value if _other_kind(inner, value) else merged(inner, value)
        else:
            result[head] = value
    return result


def _other_kind(inner: dict[str, Any], value: dict[str, Any]) -> bool:
    """Whether `value` names another model than `inner`, whose parameters it then must not inherit."""
    return "kind" in value and value["kind"] != inner.get("kind")
