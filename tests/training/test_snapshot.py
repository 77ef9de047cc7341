"""Snapshots: what is captured comes back, and what cannot be captured is refused."""

from __future__ import annotations

import json
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

import torch

from osl_env.scenario import Scenario
from training.snapshot import capture, decode, encode, restore


def test_values_come_back_as_they_were() -> None:
    rng = np.random.default_rng(3)
    value = {
        "plain": [1, 2.5, None, True, "text", b"bytes", float("inf"), (1, (2,))],
        7: deque([1, 2, 3], maxlen=3),
        "array": np.arange(6, dtype=np.float32).reshape(2, 3),
        "scalar": np.float32(0.1),
        "empty": np.zeros((0, 4)),
    }
    arrays: dict[str, Any] = {}
    back = decode(json.loads(json.dumps(encode(value | {"rng": rng}, arrays))), arrays)
    assert rng.random(4).tolist() == back.pop("rng").random(4).tolist()
    for name in ("array", "scalar", "empty"):
        before, after = value.pop(name), back.pop(name)
        assert (before.dtype, before.shape, before.tobytes()) == (after.dtype, after.shape, after.tobytes())
    assert back == value
    assert back[7].maxlen == 3
    tensor = torch.arange(3.0)
    assert torch.equal(decode(encode(tensor, arrays), arrays), tensor)


@dataclass(frozen=True, slots=True)
class Frozen:
    """Shares an array with its owner, as World and its Block do."""

    array: Any
    limits: tuple[float, ...] = (1.0, 2.0)


RECORD = np.dtype([("place", np.float64, 3), ("flag", np.bool_)], align=True)


@dataclass
class Owner:
    """Something with all kinds of state."""

    records: Any = field(default_factory=lambda: np.zeros(3, RECORD))
    count: int = 0
    late: Any = None
    rng: Any = field(default_factory=lambda: np.random.default_rng(0))
    parts: list[Any] = field(default_factory=list)
    scenario: Scenario = field(default_factory=Scenario)

    def __post_init__(self) -> None:
        self.columns = slice(0, 3)
        self.parts.append(Frozen(self.records["place"]))
        self.loop = self


def test_an_object_comes_back_in_place() -> None:
    arrays: dict[str, Any] = {}
    used, fresh = Owner(), Owner()
    used.records["place"][1] = 4.0
    used.count, used.late = 5, np.ones(2)
    used.rng.random(7)
    restore(fresh, json.loads(json.dumps(capture(used, arrays))), arrays)
    assert np.array_equal(fresh.records["place"], used.records["place"])
    assert (fresh.count, fresh.late.tolist()) == (5, [1.0, 1.0])
    assert fresh.rng.random() == used.rng.random()
    fresh.records["place"][2] = 9.0
    assert fresh.parts[0].array[2].tolist() == [9.0] * 3  # still one memory
    used.records["place"][0] = -1.0
    assert fresh.records["place"][0, 0] == 0.0  # and none of the other's


def test_an_object_of_another_making_is_refused() -> None:
    arrays: dict[str, Any] = {}
    coded = capture(Owner(), arrays)
    with pytest.raises(ValueError, match="scenario: other parameters"):
        restore(Owner(scenario=Scenario().override(name="other")), coded, arrays)
    with pytest.raises(ValueError, match="parts/1"):
        restore(Owner(parts=[Frozen(np.zeros(2))]), coded, arrays)


def test_what_is_not_known_is_refused_with_its_path() -> None:
    owner = Owner(late=np.array([object()]))
    with pytest.raises(TypeError, match=r"Owner.late: an array of Python objects cannot be saved"):
        capture(owner, {})
    owner.late = [{1, 2}]
    with pytest.raises(TypeError, match="set cannot be saved"):
        capture(owner, {})
