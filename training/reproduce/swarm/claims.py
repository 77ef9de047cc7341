"""What the paper claims of its runs, as something that ours can confirm, contradict or leave open.

Its search times stand in figures and are not at hand as numbers, so only directions are compared. Times are means with
a failed run counted as the limit; a ratio of them is the closer to 1 the more runs fail on its slower side. Claims that
begin with "(ours)" are not the paper's: they are what our readings of it predict, fixed before the figures were made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from training.report import with_interval
from training.reproduce.claims import Finding, Verdict
from training.reproduce.swarm.averages import SUCCESS, Pool, difference, ratio, ratio_of_ratios
from training.reproduce.swarm.runs import Setting
from training.statistics import Estimate, wilson

FULL = "swarm"  # the label of the paper's own law, in our readings


class SwarmClaim(Protocol):
    """Something that flown settings can decide."""

    def check(self, pool: Pool) -> Finding:
        """The verdict, with figures."""


@dataclass(frozen=True)
class BiggerIsFaster:
    """`large` robots find the source sooner than `small`, pooled over obstacles and emissions."""

    small: int
    large: int

    def check(self, pool: Pool) -> Finding:
        """Ratio of the mean times."""
        few, many = _matched(pool, self.small, self.large)
        gain = ratio(pool.mean(few), pool.mean(many))
        ours = f"mean time, N = {self.small} by N = {self.large}: {with_interval(gain, 1.0, 2)}"
        if len(few) > 1:
            ours += f", pooled over {len(few)} settings"
        return Finding(f"A bigger swarm is faster: {self.large} robots beat {self.small}", side(gain, 1.0), ours)


@dataclass(frozen=True)
class GainsMost:
    """The gain from `small` to `large` robots is larger in the hard setting than in the easy one.

    Hard: the most obstacles and the weakest source; easy: the fewest and the strongest.
    """

    small: int
    large: int

    def check(self, pool: Pool) -> Finding:
        """Ratio of the two gains."""
        few, many = _matched(pool, self.small, self.large)
        teams = dict(zip(many, few, strict=True))
        easy, hard = (choose(many, key=lambda one: (one.obstacles, -one.emission)) for choose in (min, max))
        (hard_times, easy_times) = ((pool.mean([teams[one]]), pool.mean([one])) for one in (hard, easy))
        more = ratio_of_ratios(hard_times, easy_times)
        each = " and ".join(
            f"{with_interval(ratio(*times), 1.0, 2)} ({one.obstacles} obstacles, {one.emission:g} g/s)"
            for times, one in ((hard_times, hard), (easy_times, easy))
        )
        ours = f"N = {self.small} by N = {self.large}: {each}; one by the other: {with_interval(more, 1.0, 2)}"
        return Finding("A bigger swarm helps most with many obstacles and a weak source", side(more, 1.0), ours)


@dataclass(frozen=True)
class CopesWithObstacles:
    """The source is found among obstacles in at least `rate` of the runs; the rate is ours, the paper states none."""

    rate: float = 0.9

    def check(self, pool: Pool) -> Finding:
        """Wilson's interval of all runs with obstacles."""
        among = [setting for setting in pool.where(FULL) if setting.obstacles]
        share = _share(pool, among)
        claim = f"The swarm copes with obstacles: {self.rate * 100:g} % and more of the runs succeed"
        return Finding(claim, side(share, self.rate), _successes(pool, among))


@dataclass(frozen=True)
class AlwaysSucceeds:
    """Every run of the full law finds the source, as it stands or in the reading `policy`."""

    policy: str = FULL
    text: str = "The full law always succeeds"

    def check(self, pool: Pool) -> Finding:
        """One failure contradicts."""
        settings = pool.where(self.policy)
        runs = [record for setting in settings for record in pool.flown[setting].records]
        verdict: Verdict = "holds" if all(record.success for record in runs) else "contradicted"
        return Finding(f"(ours) {self.text}", verdict, _successes(pool, settings))


@dataclass(frozen=True)
class Fails:
    """With another reading, `policy`, at most `rate` of the runs succeed; the full law flies beside it."""

    policy: str
    text: str
    rate: float

    def check(self, pool: Pool) -> Finding:
        """Wilson's interval of its runs."""
        settings = pool.where(self.policy)
        share = _share(pool, settings)
        claim = f"(ours) {self.text}: {self.rate * 100:g} % of the runs succeed, or fewer"
        ours = f"{_successes(pool, settings)}; {FULL}: {_successes(pool, beside(pool, settings))}"
        return Finding(claim, side(share, self.rate, less=True), ours)


@dataclass(frozen=True)
class SlowerThanFull:
    """`policy` takes at least `factor` times as long as the full law, or as `than`, pooled over the teams."""

    policy: str
    text: str
    factor: float = 1.0
    than: str = FULL

    def check(self, pool: Pool) -> Finding:
        """Ratio of the mean times."""
        settings = pool.where(self.policy)
        times = ratio(pool.mean(settings), pool.mean(beside(pool, settings, self.than)))
        ours = f"mean time, {self.policy} by {self.than}: {with_interval(times, 1.0, 2)}"
        return Finding(f"(ours) {self.text}", side(times, self.factor), ours)


@dataclass(frozen=True)
class SlowerForEachSuccess:
    """`policy` flies at least `factor` times as long for each success as the full law, pooled over the teams.

    A ratio of capped means cannot exceed limit by mean; this one can. It is that of the unlimited search times if a
    search that has not succeeded yet begins as if anew.
    """

    policy: str
    text: str
    factor: float = 1.0

    def check(self, pool: Pool) -> Finding:
        """Ratio of time flown by successes."""
        settings = pool.where(self.policy)
        full = beside(pool, settings)
        parts, whole = ((pool.mean(some), pool.mean(some, SUCCESS)) for some in (settings, full))
        times = ratio_of_ratios(parts, whole)
        ours = f"time flown for each success, {self.policy} by {FULL}: {with_interval(times, 1.0, 2)}"
        return Finding(f"(ours, added after the fact) {self.text}", side(times, self.factor), ours)


@dataclass(frozen=True)
class FasterWhenItSucceeds:
    """The runs of `policy` that succeed take less time than the full law's in the same worlds."""

    policy: str
    text: str

    def check(self, pool: Pool) -> Finding:
        """Ratio of the mean times over the worlds in which both succeed."""
        settings = pool.where(self.policy)
        times = ratio(*pool.where_both_succeed(settings, beside(pool, settings)))
        ours = f"time where both succeed, {self.policy} by {FULL}: {with_interval(times, 1.0, 2)}"
        return Finding(f"(ours) {self.text}", side(times, 1.0, less=True), ours)


@dataclass(frozen=True)
class LosesRuns:
    """`policy` finds the source in fewer runs than the full law."""

    policy: str
    text: str

    def check(self, pool: Pool) -> Finding:
        """Difference of the shares."""
        settings = pool.where(self.policy)
        full = beside(pool, settings)
        more = difference(pool.mean(full, SUCCESS), pool.mean(settings, SUCCESS))
        ours = f"{_successes(pool, settings)}; {FULL}: {_successes(pool, full)}; difference: "
        return Finding(f"(ours) {self.text}", side(more, 0.0), f"{ours}{with_interval(more, 100, 0)} points")


def beside(pool: Pool, settings: Sequence[Setting], policy: str = FULL) -> list[Setting]:
    """The full law's settings, or those of `policy`, where `settings` were flown."""
    return [setting._replace(policy=policy) for setting in settings if setting._replace(policy=policy) in pool.flown]


def side(ours: Estimate, limit: float, less: bool = False) -> Verdict:
    """On which side of `limit` the interval lies; open if it holds it, or if there is no interval."""
    low, high = (-ours.high, -ours.low) if less else (ours.low, ours.high)
    if low > (-limit if less else limit):
        return "holds"
    return "contradicted" if high < (-limit if less else limit) else "open"


def _matched(pool: Pool, small: int, large: int) -> tuple[list[Setting], list[Setting]]:
    """The full law's settings with `small` and with `large` robots, where both were flown."""
    few = [one for one in pool.where(FULL, small) if one._replace(n_robots=large) in pool.flown]
    return few, [one._replace(n_robots=large) for one in few]


def _share(pool: Pool, settings: Sequence[Setting]) -> Estimate:
    runs = sum(len(pool.flown[setting].records) for setting in settings)
    return wilson(sum(pool.flown[setting].n_successes for setting in settings), runs)


def _successes(pool: Pool, settings: Sequence[Setting]) -> str:
    share = _share(pool, settings)
    runs = sum(len(pool.flown[setting].records) for setting in settings)
    return f"{with_interval(share, 100, 0)} % of {runs}"
