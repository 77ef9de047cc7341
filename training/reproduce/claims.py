"""What a paper claims, as something that episodes can confirm, contradict or leave open.

Absolute figures hang on parameters that a paper does not state; directions need not. A claim is therefore a difference
with a sign, measured on the same seeds and pooled over the settings it is made for: it holds if the 95 % interval of
the pooled difference lies on the claimed side, is contradicted if it lies on the other, and is open otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from osl_env.parameters import FloatArray
from training.benchmark import Result
from training.statistics import Estimate, stratified_mean

Verdict = Literal["holds", "contradicted", "open"]

# measure -> (how it is called, unit, factor from SI, +1 if more is better)
MEASURES: dict[str, tuple[str, str, float, int]] = {
    "success_rate": ("SR", "points", 100.0, 1),
    "capped_search_time": ("capped MST", "min", 1 / 60, -1),
    "n_hovers": ("hovering points", "", 1.0, -1),
    "n_turns": ("turns", "", 1.0, -1),
    "team_path": ("flown distance", "m", 1.0, -1),
    "energy": ("energy", "kJ", 1e-3, -1),
}


@dataclass(frozen=True)
class Finding:
    """A claim, and what our episodes say about it."""

    claim: str
    verdict: Verdict
    ours: str


class Claim(Protocol):
    """Something that `results` can decide."""

    def check(self, results: Sequence[Result]) -> Finding:
        """The verdict, with figures."""


@dataclass(frozen=True)
class Beats:
    """Policy `better` beats policy `worse` in `measure`, over all settings of the experiment."""

    text: str
    better: str
    worse: str
    measure: str

    def check(self, results: Sequence[Result]) -> Finding:
        """Pool the paired differences over scenarios and swept values."""
        better, worse = ({(r.case.scenario, r.case.value): r for r in results if r.case.policy == name}
                         for name in (self.better, self.worse))  # fmt: skip
        pairs = [_paired(better[place], worse[place], self.measure) for place in better if place in worse]
        return _finding(self.text, self.measure, pairs, f"{self.better} - {self.worse}", "settings")


@dataclass(frozen=True)
class Helps:
    """Policies do better in `measure` at `after` than at `before`: two swept values, or two scenarios' labels."""

    text: str
    policies: tuple[str, ...]
    before: float | str
    after: float | str
    measure: str

    def check(self, results: Sequence[Result]) -> Finding:
        """Pool the differences over the policies; seeds are common to both settings."""
        pairs = [
            _paired(_at(results, policy, self.after), _at(results, policy, self.before), self.measure)
            for policy in self.policies
        ]
        return _finding(self.text, self.measure, pairs, f"{_named(self.after)} - {_named(self.before)}", "policies")


@dataclass(frozen=True)
class Saturates:
    """The gain in `measure` from `first` to `middle` is larger than from `middle` to `last`."""

    text: str
    policies: tuple[str, ...]
    first: float
    middle: float
    last: float
    measure: str

    def check(self, results: Sequence[Result]) -> Finding:
        """Pool the differences of the two gains, seed by seed, over the policies."""
        pairs = []
        for policy in self.policies:
            first, middle, last = (_at(results, policy, place) for place in (self.first, self.middle, self.last))
            early, late = _paired(middle, first, self.measure), _paired(last, middle, self.measure)
            pairs.append((early[0] - early[1], late[0] - late[1]))
        label = f"gain {self.first:g} to {self.middle:g} less gain {self.middle:g} to {self.last:g}"
        return _finding(self.text, self.measure, pairs, label, "policies")


def _at(results: Sequence[Result], policy: str, place: float | str) -> Result:
    for result in results:
        if result.case.policy == policy and place in (result.case.value, result.case.scenario):
            return result
    raise LookupError(f"the benchmark has no {policy} at {place}")


def _paired(first: Result, second: Result, measure: str) -> tuple[FloatArray, FloatArray]:
    ours, theirs = first.records.common_seeds(second.records)
    return ours.values(measure), theirs.values(measure)


def _named(place: float | str) -> str:
    return place if isinstance(place, str) else "unlimited" if math.isinf(place) else f"{place:g}"


def _finding(
    text: str, measure: str, pairs: Sequence[tuple[FloatArray, FloatArray]], label: str, pooled_over: str
) -> Finding:
    name, unit, factor, sign = MEASURES[measure]
    pooled = stratified_mean([(a - b) * factor for a, b in pairs])
    each = [stratified_mean([(a - b) * factor]) for a, b in pairs]
    agree = sum(_verdict(estimate, sign) == "holds" for estimate in each)
    against = sum(_verdict(estimate, sign) == "contradicted" for estimate in each)
    digits = 0 if measure in ("success_rate", "n_hovers", "n_turns", "team_path", "energy") else 1
    figures = f"{pooled.value:+.{digits}f} [{pooled.low:+.{digits}f}, {pooled.high:+.{digits}f}]"
    ours = f"{name}, {label}: {figures}{f' {unit}' if unit else ''}"
    if len(pairs) > 1:
        ours += f"; of {len(pairs)} {pooled_over}, {agree} agree clearly and {against} clearly disagree"
    return Finding(text, _verdict(pooled, sign), ours)


def _verdict(difference: Estimate, sign: int) -> Verdict:
    low, high = sorted((difference.low * sign, difference.high * sign))
    if low > 0:
        return "holds"
    return "contradicted" if high < 0 else "open"
