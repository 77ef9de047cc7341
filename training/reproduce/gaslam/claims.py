"""What the paper claims of its runs, as something that ours can confirm, contradict or leave open.

A published mean is taken as a claim of that or better: it holds if our 95 % interval lies on its better side, is
contradicted if it lies on the other, and is open otherwise. Claims that begin with "(ours)" are not the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from training.report import with_interval
from training.reproduce.claims import Finding, Verdict
from training.reproduce.gaslam.averages import (
    EMPTY,
    LESS_IS_BETTER,
    by_setting,
    difference,
    estimate,
    mean_of_means,
    over_cases,
    paired,
    succeeded,
)
from training.reproduce.gaslam.published import SUCCESS_RATE, published
from training.reproduce.gaslam.runs import Flown
from training.statistics import Estimate

POLICY = "gaslam"  # the label of the paper's own
_NAMES = {"rmse": "RMSE", "rmse_ste": "RMSE STE", "sc": "SC", "pe": "PE", "m": "M"}


class GasClaim(Protocol):
    """Something that flown cases can decide."""

    def check(self, flown: Sequence[Flown]) -> Finding:
        """The verdict, with figures."""


@dataclass(frozen=True)
class RunsSucceed:
    """The share of runs that do not fail is the published one or more."""

    rate: float = SUCCESS_RATE

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Wilson's interval of all runs together; a share that is exactly there, or above, holds."""
        share = succeeded(_of(flown, POLICY))
        verdict: Verdict = "holds" if share.value >= self.rate else "contradicted" if share.high < self.rate else "open"
        runs = sum(len(one.runs) for one in _of(flown, POLICY))
        return Finding(
            f"About {self.rate * 100:g} % of the runs succeed", verdict, f"{with_interval(share, 100)} % of {runs}"
        )


@dataclass(frozen=True)
class AsGoodAsPublished:
    """The mean of `measure` in `case` is the published one or better."""

    case: str
    measure: str

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Our interval against the published value."""
        paper, less = published(self.case, self.measure), LESS_IS_BETTER[self.measure]
        ours = estimate(next(one for one in _of(flown, POLICY) if one.name == self.case), self.measure)
        text = f"Case {self.case}: {_NAMES[self.measure]} is {paper:.4f} or {'less' if less else 'more'}"
        digits = 4 if self.measure.startswith("rmse") else 2
        return Finding(text, _side(_minus(ours, paper), less), with_interval(ours, 1.0, digits))


@dataclass(frozen=True)
class ErrorBelow:
    """The position error is below `limit`, m, on average over the cases."""

    limit: float

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Mean of the cases' means, of runs that have not failed."""
        ours = over_cases(_of(flown, POLICY), "pe")
        text = f"(ours) PE is below {self.limit:g} m on average over all cases"
        return Finding(text, _side(_minus(ours, self.limit), True), f"{with_interval(ours, 1.0, 2)} m")


@dataclass(frozen=True)
class Places:
    """The policy places the source better than `rival`."""

    rival: str

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Differences of the position error, run by run, failed ones included."""
        ours = difference(_of(flown, POLICY), _of(flown, self.rival), "pe")
        text = f"(ours) The source is placed better than by {self.rival}"
        return Finding(text, _side(ours, True), f"PE, {POLICY} - {self.rival}: {with_interval(ours, 1.0, 2)} m")


@dataclass(frozen=True)
class MapsBetterThanNothing:
    """The final map is better in `measure` than the map "no gas anywhere"."""

    measure: str

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Differences, run by run, failed ones included."""
        mine = _of(flown, POLICY)
        ours = mean_of_means([paired(one, one, self.measure, EMPTY[self.measure]) for one in mine])
        name = _NAMES[self.measure]
        text = f"(ours) The final map's {name} is better than that of no gas anywhere"
        figures = f"{name}, {POLICY} - no gas: {with_interval(ours, 1.0, 4 if self.measure == 'rmse' else 3)}"
        return Finding(text, _side(ours, LESS_IS_BETTER[self.measure]), figures)


@dataclass(frozen=True)
class Worsens:
    """Another reading, `setting`, places the source worse than the first setting does."""

    setting: str
    text: str

    def check(self, flown: Sequence[Flown]) -> Finding:
        """Differences of the position error, run by run, failed ones included."""
        base = next(iter(by_setting(flown)))
        ours = difference(_of(flown, self.setting), _of(flown, base), "pe")
        figures = f"PE, {self.setting} - {base}: {with_interval(ours, 1.0, 2)} m"
        return Finding(f"(ours) {self.text}", _side(ours, False), figures)


def _of(flown: Sequence[Flown], setting: str) -> list[Flown]:
    return by_setting(flown)[setting]


def _minus(figures: Estimate, value: float) -> Estimate:
    return Estimate(*(figure - value for figure in figures))


def _side(ours: Estimate, less_is_better: bool) -> Verdict:
    """On which side of 0 the interval lies."""
    low, high = (-ours.high, -ours.low) if less_is_better else (ours.low, ours.high)
    if low >= 0.0:
        return "holds"
    return "contradicted" if high < 0.0 else "open"
