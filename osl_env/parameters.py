"""The base of every model: frozen, checked parameters with units.

A model is a frozen pydantic object whose fields are parameters in SI units. `quantity` declares a field with its unit
and limits. A value may be written with another unit of the same dimension ("20 min", "36 km/h"); it is converted
once, when the object is made. Unknown keys, NaN, infinities where none are allowed and booleans are refused.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from osl_env.errors import InputError

UNKNOWN_KEY: Literal["unknown_key"] = "unknown_key"  # pydantic's type of the error that a key is not a parameter
FloatArray: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]  # x, y, z


# a number and a product or quotient of units with one-digit powers: pint evaluates formulas, which files must not hold
_UNIT = r"[^\W\d_]+(?:\s*(?:\^|\*\*)\s*-?\d)?"
_QUANTITY = re.compile(rf"\s*[-+]?[\d.]+(?:e[-+]?\d{{1,3}})?\s*/?\s*{_UNIT}(?:\s*[*/ ]\s*{_UNIT})*\s*", re.IGNORECASE)


def quantity(default: Any, unit: str, *, infinite: bool = False, **limits: Any) -> Any:
    """A pydantic field for a physical quantity in `unit`; `limits` are pydantic's (gt, ge, lt, le).

    `default=...` makes it required; `infinite=True` allows an infinite value (no limit).
    """
    extra: dict[str, Any] = {"unit": unit, "infinite": infinite}
    return Field(default, json_schema_extra=extra, **limits)


@functools.cache
def _unit_registry() -> Any:
    import pint  # slow to import, and needed only where a value is written with a unit

    return pint.UnitRegistry()


def _to_unit(text: str, unit: str) -> float:
    """The number that `text` ("20 min", "1e3") means in `unit`."""
    try:
        return float(text)
    except ValueError:
        pass
    if not _QUANTITY.fullmatch(text[:100]):
        raise ValueError(f"must be a number or a quantity in {unit or 'no unit'}")
    try:
        return float(_unit_registry().Quantity(text).to(unit or "dimensionless").magnitude)
    except Exception as error:
        raise ValueError(f"must be a number or a quantity in {unit or 'no unit'} ({error})") from None


def _checked(value: Any, unit: str, infinite: bool) -> Any:
    if isinstance(value, list | tuple):
        return [_checked(entry, unit, infinite) for entry in value]
    if isinstance(value, bool):
        raise ValueError(f"must be a number{f' in {unit}' if unit else ''}, not a truth value")
    if isinstance(value, str):
        value = _to_unit(value, unit)
    if isinstance(value, float) and not math.isfinite(value) and not (infinite and value > 0):
        raise ValueError("must be finite or inf, and not below 0" if infinite else "must be finite")
    return value


class Parameters(BaseModel):
    """A model's parameters: frozen, no unknown keys, quantities with units (see `quantity`)."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        ser_json_inf_nan="constants",  # by default inf would be null
        defer_build=True,  # until a model is first used: most are not
    )

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        if "kind" in cls.model_fields:
            _KINDS.add(cls.model_fields["kind"].default)

    @model_validator(mode="before")
    @classmethod
    def _convert_quantities(cls, values: Any) -> Any:
        if not isinstance(values, dict):
            return values
        allowed = tuple(field.alias or name for name, field in cls.model_fields.items())
        for key in values:
            if key not in allowed:
                known = {"key": str(key), "allowed": allowed}
                raise PydanticCustomError(UNKNOWN_KEY, "unknown key {key}", known)
        converted = dict(values)
        for name, field in cls.model_fields.items():
            extra = field.json_schema_extra
            if name in converted and isinstance(extra, dict) and "unit" in extra and field.discriminator is None:
                try:
                    converted[name] = _checked(converted[name], str(extra["unit"]), bool(extra["infinite"]))
                except ValueError as error:
                    raise ValueError(f"{name} = {values[name]!r}: {error}") from None
        return converted


# keys whose value is one of several models, chosen by its `kind`: pydantic puts the kind into a problem's path
_CHOSEN_BY_KIND = {"plume", "advertised_plume", "wind", "vehicle", "gas_sensor", "dispersion", "energy"}
_KINDS: set[int | str] = set()  # of all models
_MAPPING = "a mapping of keys and values"
# pydantic's name for a value of the wrong shape -> what is allowed, in a file's words
_SHAPES = {
    "model_type": _MAPPING,
    "model_attributes_type": _MAPPING,
    "dict_type": _MAPPING,
    "tuple_type": "a list",
    "list_type": "a list",
}


def _key_path(location: tuple[int | str, ...]) -> str:
    """The path of a key as it is written in a file."""
    above = [location[k - 1] if k > 0 else "" for k in range(len(location))]
    chosen = [
        part in _KINDS and (key in _CHOSEN_BY_KIND or isinstance(key, int))  # of a key, or of an entry of a list
        for key, part in zip(above, location, strict=True)
    ]
    return ".".join(str(part) for part, by_kind in zip(location, chosen, strict=True) if not by_kind)


def one_line(error: ValidationError, where: str | Path = "") -> InputError:
    """The first problem of a pydantic ValidationError as an InputError: file, key's path, value and limit."""
    first = error.errors()[0]
    path = _key_path(first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    value = first.get("input")
    last = path.rpartition(".")[2]
    if first["type"] == "value_error" and message.startswith((f"{last} = ", f"{last}.")):
        path = path.removesuffix(last).removesuffix(".")  # a validator of the key itself says its name
    if first["type"] == UNKNOWN_KEY:
        key, allowed = first["ctx"]["key"], first["ctx"]["allowed"]
        near = difflib.get_close_matches(key, allowed, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        full = f"{path}.{key}" if path else key
        text = f"unknown key {full!r}: {hint}allowed are {', '.join(allowed) or 'none'}"
    elif first["type"] == "extra_forbidden":
        text = f"unknown key {path!r}"
    elif first["type"] == "value_error":
        text = (
            f"{path}.{message}"
            if path and " = " in message.split(":")[0]
            else f"{path}: {message}"
            if path
            else message
        )
    elif first["type"] == "union_tag_invalid":
        text = f"{path}.kind = {first['ctx']['tag']!r}: allowed are {first['ctx']['expected_tags']}"
    elif first["type"] == "missing":
        text = f"key {path!r} is missing"
    elif first["type"] == "too_long":
        text = f"{path} = {value!r}: must have at most {first['ctx']['max_length']} entries"
    elif first["type"] in _SHAPES:
        text = f"{path} = {value!r}: must be {_SHAPES[first['type']]}"
    else:
        text = f"{path} = {value!r}: {message[0].lower()}{message[1:]}"
    return InputError(f"{where}: {text}" if where else text)
