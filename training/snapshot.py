"""The mutable state of an object as arrays and JSON, and back: what a resumed training needs, without pickle.

`encode` and `decode` take plain values: numbers, texts, containers, arrays, tensors, generators. `capture` walks an
object with everything that it owns (a VecEnv with its worlds and features) and encodes what it finds by path
(`worlds/0/motion`); `restore` puts that back into a fresh object of the same making, in place where an array's shape
allows it, so that arrays that share memory go on sharing it. Parameter objects are not state, but must be the same
ones; spaces, functions and classes are left out. A kind of value that is not known here is refused when saving: nothing
is forgotten silently.
"""

from __future__ import annotations

import dataclasses
import hashlib
import operator
from collections import deque
from collections.abc import Callable, Iterator
from enum import Enum
from functools import partial
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, NamedTuple, TypeAlias

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel

Arrays: TypeAlias = dict[str, NDArray[Any]]
_PLAIN = (bool, int, float, str, bytes, type(None))
_FIXED = (BaseModel, slice, range, Enum, np.dtype)  # not state, but they must be the same ones
_LEAVES = (*_PLAIN, np.ndarray, np.generic, torch.Tensor, np.random.Generator, *_FIXED)
_FUNCTIONS = (FunctionType, BuiltinFunctionType, MethodType, ModuleType)
_CONTAINERS = (dict, list, tuple, deque)


def encode(value: Any, arrays: Arrays) -> Any:
    """`value` as JSON, its arrays put into `arrays` under numbers. Raises TypeError for a kind that is not known."""
    if isinstance(value, bytes):
        return {"bytes": value.hex()}
    if isinstance(value, _PLAIN):
        return value
    if isinstance(value, np.random.Generator):
        return {"generator": encode(value.bit_generator.state, arrays)}
    if isinstance(value, torch.Tensor):
        return {"tensor": _keep(value.detach().cpu().numpy(), arrays)}
    if isinstance(value, np.generic):
        return {"scalar": _keep(np.asarray(value), arrays)}
    if isinstance(value, _FIXED):
        return {"fixed": _digest(value)}
    if isinstance(value, np.ndarray):
        return {"array": _keep(value, arrays), "dtype": str(value.dtype), "shape": list(value.shape)}
    if isinstance(value, dict):
        return {"dict": [[encode(key, arrays), encode(entry, arrays)] for key, entry in value.items()]}
    if isinstance(value, deque):
        return {"deque": [encode(entry, arrays) for entry in value], "maxlen": value.maxlen}
    if isinstance(value, list | tuple):
        return {"list" if isinstance(value, list) else "tuple": [encode(entry, arrays) for entry in value]}
    raise TypeError(f"a {type(value).__name__} cannot be saved")


def _digest(value: Any) -> str:
    if getattr(value, "__private_attributes__", None):
        raise TypeError(f"a {type(value).__name__}, which has state of its own, cannot be saved")
    content = value.model_dump_json() if isinstance(value, BaseModel) else repr(value)
    return hashlib.sha256(content.encode()).hexdigest()[:16]


def _keep(array: NDArray[Any], arrays: Arrays) -> str:
    if array.dtype.hasobject:
        raise TypeError("an array of Python objects cannot be saved")
    name = str(len(arrays))
    packed = np.zeros(array.shape, array.dtype)  # a copy whose padding between fields does not depend on chance
    packed[...] = array
    arrays[name] = packed.reshape(-1).view(np.uint8) if array.dtype.names or array.dtype.kind not in "biuf" else packed
    return name


def decode(coded: Any, arrays: Arrays) -> Any:
    """The value that `encode` was given; tensors on the CPU."""
    if not isinstance(coded, dict):
        return coded
    kind = next(iter(coded))
    content = coded[kind]
    if kind == "bytes":
        return bytes.fromhex(content)
    if kind == "array":
        return _plain_array(coded, arrays)
    if kind == "scalar":
        return arrays[content][()]
    if kind == "tensor":
        return torch.from_numpy(np.array(arrays[content]))
    if kind == "generator":
        state = decode(content, arrays)
        generator = np.random.Generator(getattr(np.random, state["bit_generator"])())
        generator.bit_generator.state = state
        return generator
    if kind == "dict":
        return {decode(key, arrays): decode(entry, arrays) for key, entry in content}
    entries = [decode(entry, arrays) for entry in content]
    if kind == "deque":
        return deque(entries, coded["maxlen"])
    return tuple(entries) if kind == "tuple" else entries


def _plain_array(coded: dict[str, Any], arrays: Arrays) -> NDArray[Any]:
    array = arrays[coded["array"]]
    if str(array.dtype) != coded["dtype"]:
        raise ValueError(f"an array of {coded['dtype']:.60} fits only into one that is there")
    return np.array(array)


class Leaf(NamedTuple):
    """One piece of state and how to replace it."""

    value: Any
    put: Callable[[Any], None]


def capture(root: object, arrays: Arrays) -> dict[str, Any]:
    """Path -> code of all state that `root` owns, its arrays put into `arrays`.

    Raises TypeError, with the path, for a kind of value that is not known.
    """
    coded: dict[str, Any] = {}
    stored: dict[int, Any] = {}  # code of arrays by identity: what is met on two paths is stored once
    for path, leaf in _leaves(root):
        try:
            coded[path] = stored.get(id(leaf.value)) or encode(leaf.value, arrays)
            if isinstance(leaf.value, np.ndarray):
                stored[id(leaf.value)] = coded[path]
        except TypeError as error:
            raise TypeError(f"{type(root).__name__}.{path.replace('/', '.')}: {error}") from None
    return coded


def restore(root: object, coded: dict[str, Any], arrays: Arrays) -> None:
    """Put what `capture` gave back into `root`, an object made in the same way.

    Raises ValueError, with the path, if it was made in another way.
    """
    leaves = dict(_leaves(root))
    if leaves.keys() != coded.keys():
        raise ValueError(f"{min(leaves.keys() ^ coded.keys())} is in one of them only")
    for path, leaf in leaves.items():
        try:
            _put(leaf, coded[path], arrays)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ValueError(f"{path}: {error}") from None


def _put(leaf: Leaf, coded: Any, arrays: Arrays) -> None:
    present = leaf.value
    if isinstance(present, np.ndarray) and isinstance(coded, dict) and "array" in coded:
        same_kind = coded["dtype"] == str(present.dtype) and coded["shape"] == list(present.shape)
        if same_kind:
            saved = arrays[coded["array"]]
            content = saved if saved.dtype == present.dtype else saved.view(present.dtype).reshape(present.shape)
            if present.flags.writeable:
                present[...] = content
            elif present.tobytes() != content.tobytes():
                raise ValueError("a constant differs")
            return
    if isinstance(present, _FIXED):
        if coded != {"fixed": _digest(present)}:
            raise ValueError("other parameters")
        return
    if isinstance(present, np.random.Generator):
        present.bit_generator.state = decode(coded, arrays).bit_generator.state
        return
    value = decode(coded, arrays)
    if not _same(value, present):  # what is frozen must not be touched
        leaf.put(value)


def _same(one: Any, other: Any) -> bool:
    first: Arrays = {}
    second: Arrays = {}
    if encode(one, first) != encode(other, second):
        return False
    return all(first[name].tobytes() == second[name].tobytes() for name in first)


def _leaves(root: object) -> Iterator[tuple[str, Leaf]]:
    """All state of `root` by path; an object that can be reached on two paths is entered once."""
    met = {id(root)}
    pending: list[tuple[str, Any]] = [("", root)]
    while pending:
        path, holder = pending.pop()
        for name, value, put in _parts(holder):
            place = f"{path}/{name}" if path else name
            if isinstance(value, _LEAVES) or (isinstance(value, _CONTAINERS) and _is_plain(value)):
                yield place, Leaf(value, put)
            elif not _is_constant(value) and id(value) not in met:
                met.add(id(value))
                pending.append((place, value))


def _parts(holder: Any) -> Iterator[tuple[str, Any, Callable[[Any], None]]]:
    """Name, value and setter of all that `holder` holds."""
    if isinstance(holder, _CONTAINERS):
        items = holder.items() if isinstance(holder, dict) else enumerate(holder)
        yield from ((str(key), value, partial(operator.setitem, holder, key)) for key, value in items)
        return
    slots = [name for kind in type(holder).__mro__ for name in _as_tuple(getattr(kind, "__slots__", ()))]
    names = [*getattr(holder, "__dict__", {}), *(name for name in slots if hasattr(holder, name))]
    if not (names or hasattr(holder, "__dict__") or dataclasses.is_dataclass(holder)):
        raise TypeError(f"a {type(holder).__name__} cannot be saved")
    yield from (
        (name, getattr(holder, name), partial(setattr, holder, name)) for name in names if not name.startswith("__")
    )


def _as_tuple(slots: Any) -> tuple[str, ...]:
    return (slots,) if isinstance(slots, str) else tuple(slots)


def _is_plain(value: Any) -> bool:
    """Whether `value` is state that can be replaced as a whole: not a named tuple, whose type would be lost."""
    if isinstance(value, dict):
        return all(map(_is_plain, value.values())) and all(isinstance(key, _PLAIN) for key in value)
    if isinstance(value, list | tuple | deque):
        return type(value) in (list, tuple, deque) and all(map(_is_plain, value))
    return isinstance(value, _LEAVES) and not isinstance(value, _FIXED)


def _is_constant(value: Any) -> bool:
    """Whether `value` never changes, or is no state of the episodes."""
    if isinstance(value, gymnasium.Space | type):
        return True
    return isinstance(value, _FUNCTIONS) or type(value).__module__.startswith("numba.")
