"""Which features a learned agent observes: parameters, sizes, names and a hash of each composition.

A spec is a tuple of feature objects, told apart in a file by `kind`; an observation is their numbers one after the
other, each in [-1, 1]. What a spec means never depends on the number of UAVs: tables of neighbours have a fixed number
of places, and absent ones are masked and hold zeros, so that one policy serves teams of any size.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, TypeAdapter, ValidationError

from osl_env.errors import InputError
from osl_env.observation import ObservationLayout
from osl_env.parameters import Parameters, one_line, quantity
from osl_env.scenario import Scenario

_VERSION = 1  # of the meaning of the numbers: raise it when a kernel changes what it writes
_FIELDS = ObservationLayout(Scenario.model_validate({"team": {"n_uavs": 2}})).fields
NEIGHBOUR_SIZE = sum(field.size for field in _FIELDS if field.name in {  # numbers of one place of the raw table
    "neighbour_mask", "neighbour_offset", "neighbour_reading", "neighbour_sampling_time", "neighbour_age"
})  # fmt: skip


def _own_names() -> tuple[str, ...]:
    """The names of a raw observation's numbers, without its neighbours; of the fields that repeat, with their place."""
    names: list[str] = []
    fields = [field for field in _FIELDS if field.normalised != "no" and not field.name.startswith("neighbour")]
    counts = Counter(field.name for field in fields)
    seen: Counter[str] = Counter()
    for field in fields:
        name = field.name if counts[field.name] == 1 else f"{field.name}[{seen[field.name]}]"
        seen[field.name] += 1
        names += [name] if field.size == 1 else [f"{name}.{axis}" for axis in "xyz"]
    return tuple(names)


OWN_NAMES = _own_names()
OWN_SIZE = len(OWN_NAMES)  # numbers of a raw observation without its neighbours
HIT_NAMES = ("mask", "offset.x", "offset.y", "offset.z", "age", "reading", "sampling_time")
TEAM_NAMES = (
    "mask", "offset.x", "offset.y", "offset.z", "near.x", "near.y", "near.z", "reading", "sampling_time", "age"
)  # fmt: skip
BELIEF_NAMES = (
    "offset.x", "offset.y", "offset.z", "near.x", "near.y", "near.z", "spread.x", "spread.y", "spread.z",
    "correlation.xy", "correlation.xz", "correlation.yz", "entropy", "mass_here", "mass_at_mean", "hits", "silence",
)  # fmt: skip
MAP_NAMES = tuple(
    f"{ring}.{octant * 45}.{side}"
    for ring in ("inner", "middle", "outer")
    for octant in range(8)
    for side in ("below", "above")
)


class RawFeatures(Parameters):
    """The environment's own flat observation, with `neighbours` places for what was heard (nearest first)."""

    kind: Literal["raw"] = "raw"
    neighbours: int = quantity(7, "", ge=0, le=63)

    @property
    def names(self) -> list[str]:
        """One name for each number."""
        columns = ("mask", "offset.x", "offset.y", "offset.z", "reading", "sampling_time", "age")
        return [*OWN_NAMES, *(f"neighbour[{k}].{name}" for k in range(self.neighbours) for name in columns)]


class HitsFeatures(Parameters):
    """The last `length` readings, latest first: where they were taken, how long ago, and what was read."""

    kind: Literal["hits"] = "hits"
    length: int = quantity(8, "", ge=1, le=256)
    heard: bool = False  # with the readings that came by radio
    detections_only: bool = False  # leave out readings of zero

    @property
    def names(self) -> list[str]:
        """One name for each number."""
        return [f"reading[{k}].{name}" for k in range(self.length) for name in HIT_NAMES]


class BeliefFeatures(Parameters):
    """The UAV's own particle belief: moments, entropy, mass near by, and a coarse map around the UAV."""

    kind: Literal["belief"] = "belief"
    particles: int = quantity(64, "", ge=16, le=16384, multiple_of=16)
    resample_below: float = quantity(0.5, "", ge=0, le=1)  # effective sample size over the number of particles
    roughening: float = quantity(
        1.5, "", ge=0
    )  # times Silverman's bandwidth, after resampling; chosen on seeds 900 to 939
    inner_radius: float = quantity(4.0, "m", gt=0)  # of the map's rings
    outer_radius: float = quantity(16.0, "m", gt=0)

    @property
    def names(self) -> list[str]:
        """One name for each number."""
        return [*BELIEF_NAMES, *(f"map.{name}" for name in MAP_NAMES)]


class TeamFeatures(Parameters):
    """A table with a place for each of `slots` teammates, nearest first, for attention or pooling over them."""

    kind: Literal["team"] = "team"
    slots: int = quantity(7, "", ge=1, le=63)

    @property
    def names(self) -> list[str]:
        """One name for each number."""
        return [f"teammate[{k}].{name}" for k in range(self.slots) for name in TEAM_NAMES]


Feature: TypeAlias = Annotated[RawFeatures | HitsFeatures | BeliefFeatures | TeamFeatures, Field(discriminator="kind")]
FeatureSpec: TypeAlias = tuple[Feature, ...]
DEFAULT_FEATURES: FeatureSpec = (RawFeatures(),)
_ADAPTER: TypeAdapter[FeatureSpec] = TypeAdapter(FeatureSpec)


def make_spec(features: Any, where: str | Path = "features") -> FeatureSpec:
    """The spec that a list of mappings (as read from YAML) or of feature objects means.

    Raises InputError, one line with `where`, for an unknown kind or key, a value out of its limits, or no feature.
    """
    try:
        spec = _ADAPTER.validate_python(features)
    except ValidationError as error:
        raise one_line(error, where) from None
    if not spec:
        raise InputError(f"{where}: must name at least one feature (raw, hits, belief or team)")
    return spec


def spec_names(spec: FeatureSpec) -> list[str]:
    """A name for each number of an observation, `kind.quantity`."""
    return [f"{feature.kind}.{name}" for feature in spec for name in feature.names]


def spec_size(spec: FeatureSpec) -> int:
    """How many numbers an observation has."""
    return len(spec_names(spec))


def spec_slices(spec: FeatureSpec) -> list[slice]:
    """Where each feature's numbers stand in an observation."""
    slices, start = [], 0
    for feature in spec:
        slices.append(slice(start, start + len(feature.names)))
        start = slices[-1].stop
    return slices


def spec_hash(spec: FeatureSpec) -> str:
    """12 hexadecimal digits that change with anything that changes what the numbers mean."""
    content = [_VERSION, [feature.model_dump(mode="json") for feature in spec], spec_names(spec)]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]
