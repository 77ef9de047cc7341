"""Randomised scenarios for training: what varies from group to group of worlds, and when, from one configuration.

    scenario: rate-100x60x30-random
    groups: 16
    vary:
      team.n_uavs: {choices: [1, 2, 3, 4, 6, 8]}
      arena.size: {low: [60, 60, 30], high: [150, 150, 50]}
      plume.source_strength: {low: 1, high: 10, log: true}
      wind.speed: [0.3, 2]
      starts: {choices: [scenario, anywhere]}
      mismatch.source_strength: {low: 0.5, high: 2, log: true}
    curriculum:
      - {until: 0.2, vary: {team.n_uavs: {choices: [3]}, mismatch.source_strength: {choices: [1]}}}
    redraw: 0.25
    redraw_every: 64

A key is a scenario's dotted key, or one of these: `wind.speed`, m/s, and `wind.direction`, rad (the base's other is
kept); `starts` and `sources`: `scenario` (the base's), `anywhere`, or, for starts, `corner` (a third of each side);
`mismatch.PARAMETER`: the factor by which the advertised plume's parameter is off. Places and regions of the base are
stretched with the area. Values are drawn by Latin hypercube: over the groups, each key covers its range evenly.
Episodes of a group differ by their seeds as always: source, wind and noise are drawn anew as the scenario says.
After every `redraw_every` decisions, a share `redraw` of the groups, those drawn longest ago, is drawn anew.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from osl_env.configuration import merged
from osl_env.envs.spaces import uav_action_space
from osl_env.errors import InputError
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.winds.mean_wind import MeanWind

_PLACES = ("scenario", "anywhere", "corner")
_CORNER = 1.0 / 3.0  # of each side
_MISMATCH = "mismatch."


class Variation(Parameters):
    """What one key is drawn from: one of `choices`, or a number (or vector) from `low` to `high`."""

    choices: tuple[Any, ...] | None = None
    low: Any = None
    high: Any = None
    log: bool = False  # uniform in the logarithm
    integer: bool = False  # whole numbers, `high` included

    @model_validator(mode="before")
    @classmethod
    def _pair(cls, value: Any) -> Any:
        """A list of two numbers is a range."""
        if isinstance(value, list | tuple) and len(value) == 2:
            return {"low": value[0], "high": value[1]}
        return value

    @model_validator(mode="after")
    def _complete(self) -> Variation:
        if self.choices is not None:
            if len(self.choices) == 0 or self.low is not None or self.high is not None:
                raise ValueError("must be either choices (at least one) or low and high")
            return self
        try:
            low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        except (TypeError, ValueError):
            raise ValueError(f"low = {self.low!r}, high = {self.high!r}: must be numbers or vectors") from None
        if low.shape != high.shape or not (np.isfinite(low).all() and np.isfinite(high).all()) or (low > high).any():
            raise ValueError(f"low = {self.low!r}, high = {self.high!r}: must be finite, of one shape, low first")
        if self.log and (low <= 0).any():
            raise ValueError(f"low = {self.low!r}: must be above 0 for a logarithmic range")
        return self

    def at(self, quantile: FloatArray) -> Any:
        """The value at `quantile` (n,) in [0, 1), a number for each component of a vector (the first for all else)."""
        if self.choices is not None:
            return self.choices[int(quantile[0] * len(self.choices))]
        low, high = np.asarray(self.low, dtype=np.float64), np.asarray(self.high, dtype=np.float64)
        u = quantile[: low.size].reshape(low.shape)
        if self.integer:
            value = np.floor(low + u * (high - low + 1.0))
        elif self.log:
            value = np.exp(np.log(low) + u * (np.log(high) - np.log(low)))
        else:
            value = low + u * (high - low)
        return (value.astype(np.int64) if self.integer else value).tolist()

    @property
    def size(self) -> int:
        """How many numbers a draw needs."""
        return 1 if self.choices is not None else max(1, np.asarray(self.low).size)

    def extremes(self) -> list[Any]:
        """Every choice, or both ends."""
        if self.choices is not None:
            return list(self.choices)
        return [self.at(np.zeros(self.size)), self.at(np.full(self.size, 1.0 - 1e-12))]


class Stage(Parameters):
    """A stage of the curriculum: until that share of the training, its variations take the place of the others."""

    until: float = quantity(..., "", gt=0, le=1)
    vary: dict[str, Variation] = Field(default_factory=dict)


class Randomisation(Parameters):
    """Scenarios around one base (see the module)."""

    scenario: str
    overrides: dict[str, Any] = Field(default_factory=dict)
    groups: int = quantity(8, "", ge=1, le=4096)  # scenarios side by side
    vary: dict[str, Variation] = Field(default_factory=dict)
    curriculum: tuple[Stage, ...] = ()
    redraw: float = quantity(0.25, "", gt=0, le=1)  # share of the groups that is drawn anew at a time
    redraw_every: int = quantity(64, "", ge=1)  # decisions of each slot from one time to the next

    @field_validator("curriculum")
    @classmethod
    def _in_order(cls, stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
        ends = [stage.until for stage in stages]
        if ends != sorted(set(ends)):
            raise ValueError(f"curriculum: until = {ends}: must rise from stage to stage")
        return stages

    def base(self) -> Scenario:
        """The base scenario. Raises InputError for an unknown name or a bad override."""
        return load_scenario(self.scenario, **self.overrides)

    def variations(self, progress: float) -> dict[str, Variation]:
        """What varies when the share `progress` of the training is done."""
        for stage in self.curriculum:
            if progress < stage.until:
                return self.vary | stage.vary
        return self.vary

    def draw(self, progress: float, count: int, rng: np.random.Generator) -> list[Scenario]:
        """`count` scenarios, when the share `progress` of the training is done. Raises InputError for a bad value."""
        base, variations = self.base(), self.variations(progress)
        chosen: list[dict[str, Any]] = [{} for _ in range(count)]
        for key in sorted(variations):
            variation = variations[key]
            strata = np.stack([rng.permutation(count) for _ in range(variation.size)], axis=1)
            quantiles = (strata + rng.random((count, variation.size))) / count
            for values, quantile in zip(chosen, quantiles, strict=True):
                values[key] = variation.at(quantile)
        return [varied(base, values) for values in chosen]

    @property
    def max_uavs(self) -> int:
        """The largest team of any stage."""
        key, base = "team.n_uavs", self.base().team.n_uavs
        stages = [self.vary, *(self.vary | stage.vary for stage in self.curriculum)]
        return max(int(max(vary[key].extremes())) if key in vary else base for vary in stages)

    def check(self) -> Scenario:
        """The base scenario. Raises InputError if a key or an end of a range is refused, or changes the actions."""
        base = self.base()
        space = uav_action_space(base)
        for variations in (self.vary, *(self.vary | stage.vary for stage in self.curriculum)):
            firsts = {key: variation.extremes()[0] for key, variation in variations.items()}
            for key, variation in variations.items():
                for value in variation.extremes():
                    if uav_action_space(varied(base, firsts | {key: value})) != space:
                        raise InputError(f"vary: {key} = {value!r}: changes the action space; it must not vary")
        return base


def varied(base: Scenario, values: dict[str, Any]) -> Scenario:
    """`base` with `values` by key (see the module). Raises InputError for an unknown key or a bad value."""
    plain = {key: value for key, value in values.items() if not _is_special(key)}
    changes: dict[str, Any] = {}
    if "arena.size" in values:
        changes = _stretched(base, values["arena.size"])
    content = merged(merged(base.model_dump(), changes), plain)
    area = content["arena"]["size"]
    if "starts" in values:
        content["team"]["region"] = _region("starts", values["starts"], area, content["team"]["region"])
    if "sources" in values:
        content["sources"]["region"] = _region("sources", values["sources"], area, content["sources"]["region"])
    if "wind.speed" in values or "wind.direction" in values:
        content["wind"]["velocity"] = _wind(base, values)
    factors = {key.removeprefix(_MISMATCH): value for key, value in values.items() if key.startswith(_MISMATCH)}
    if factors:
        content["advertised_plume"] = _advertised(content, factors)
    return base.override(**content)


def _is_special(key: str) -> bool:
    return key in ("starts", "sources", "wind.speed", "wind.direction") or key.startswith(_MISMATCH)


def _stretched(base: Scenario, size: Any) -> dict[str, Any]:
    """The changes that fit the base's places to an area of `size`, m."""
    if not isinstance(size, Sequence) or len(size) != 3 or not all(isinstance(side, int | float) for side in size):
        raise InputError(f"arena.size = {size!r}: must be three sides in m")
    old = base.arena.size

    def moved(place: Sequence[float]) -> list[float]:
        return [min(x / a * b, b) for x, a, b in zip(place, old, size, strict=True)]

    changes: dict[str, Any] = {
        "team.starts": [moved(place) for place in base.team.starts],
        "sources.positions": [moved(place) for place in base.sources.positions],
    }
    if base.team.region is not None:
        changes["team.region"] = [moved(corner) for corner in base.team.region]
    if base.sources.region is not None:
        changes["sources.region"] = [moved(corner) for corner in base.sources.region]
    return changes


def _region(key: str, where: Any, area: Sequence[float], region: Any) -> Any:
    """The region that `where` means."""
    allowed = _PLACES if key == "starts" else _PLACES[:2]
    if where not in allowed:
        raise InputError(f"{key} = {where!r}: must be one of {', '.join(allowed)}")
    if where == "scenario":
        return region
    share = 1.0 if where == "anywhere" else _CORNER
    return [[0.0, 0.0, 0.0], [share * side for side in area]]


def _wind(base: Scenario, values: dict[str, Any]) -> list[float]:
    """The wind's velocity, m/s; without a wind in the base, it blows along -y."""
    wind = base.wind
    if not isinstance(wind, MeanWind):
        raise InputError(f"wind.speed, wind.direction: wind {wind.kind!r} has no mean velocity that could be varied")
    east, north, _ = wind.velocity
    speed = values.get("wind.speed", wind.speed)
    direction = values.get("wind.direction", math.atan2(north, east) if wind.speed > 0 else -math.pi / 2.0)
    if not isinstance(speed, int | float) or speed < 0 or not isinstance(direction, int | float):
        raise InputError(f"wind.speed = {speed!r}, wind.direction = {direction!r}: must be numbers, a speed at least 0")
    return [speed * math.cos(direction), speed * math.sin(direction), 0.0]


def _advertised(content: dict[str, Any], factors: dict[str, Any]) -> dict[str, Any]:
    """The plume as told: the true one with its parameters multiplied by `factors`."""
    plume: dict[str, Any] = dict(content["advertised_plume"] or content["plume"])
    for name, factor in factors.items():
        if name not in plume or not isinstance(plume[name], int | float) or not isinstance(factor, int | float):
            numbers = ", ".join(key for key, value in plume.items() if isinstance(value, int | float))
            raise InputError(f"{_MISMATCH}{name} = {factor!r}: must be a factor of one of {numbers}")
        plume[name] = plume[name] * factor
    return plume
