"""Results side by side: each policy's estimates, and its paired differences from references on the same seeds.

The references are named by the benchmark; by default there is one, the best policy of each group.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from training.benchmark import Result
from training.records import EpisodeRecords
from training.statistics import (
    Comparison,
    Estimate,
    bootstrap_mean,
    compare_paired,
    compare_successes,
    holm,
    wilcoxon,
    wins,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Against:
    """A policy minus a reference, over the seeds that both flew. The p values of a group are corrected by Holm."""

    search_time: Comparison  # capped, s
    success_rate: Comparison
    reference_faster: Estimate  # share of the seeds on which the reference's capped time is shorter; a tie is half
    wilcoxon_p: float  # of the capped search times, uncorrected; NaN without pairs

    def mirrored(self) -> Against:
        """The reference minus the policy."""
        share = self.reference_faster
        return Against(
            _negative(self.search_time),
            _negative(self.success_rate),
            Estimate(1.0 - share.value, 1.0 - share.high, 1.0 - share.low),
            self.wilcoxon_p,
        )

    def corrected(self, search_time_p: float, success_rate_p: float) -> Against:
        """With these p values."""
        return Against(
            self.search_time._replace(p_value=search_time_p),
            self.success_rate._replace(p_value=success_rate_p),
            self.reference_faster,
            self.wilcoxon_p,
        )


@dataclass(frozen=True)
class Row:
    """One line of a table."""

    result: Result
    estimates: dict[str, Estimate]  # SI units; see EpisodeRecords.summary
    best: bool  # of its group
    against: dict[str, Against]  # by the references' labels; none against itself

    @property
    def label(self) -> str:
        """The policy's."""
        return self.result.case.policy


@dataclass(frozen=True)
class Group:
    """All policies in one scenario (and at one value of a swept parameter), in the order of the benchmark."""

    scenario: str
    value: float | None
    rows: tuple[Row, ...]
    references: tuple[str, ...]  # labels of the policies that the others are compared with
    picked: bool  # no reference was named: it is the best policy, found from the same episodes


def grouped(results: Iterable[Result], references: Sequence[str] = ()) -> list[Group]:
    """The results by scenario and swept value, each group compared with `references` (labels), or with its best policy.

    The best has the least capped mean search time, then the higher success rate. Picked from the same episodes, it is
    best by luck in part: p values against it say how far the others are from it, not that it would win again. Those
    against a reference that was named beforehand have no such flaw.
    """
    groups: dict[tuple[str, float | None], list[Result]] = {}
    for result in results:
        groups.setdefault((result.case.scenario, result.case.value), []).append(result)
    return [_compared(*key, members, references) for key, members in groups.items()]


def _compared(scenario: str, value: float | None, results: list[Result], references: Sequence[str]) -> Group:
    estimates = [result.records.summary() for result in results]
    labels = [result.case.policy for result in results]
    best = min(
        range(len(results)),
        key=lambda k: (estimates[k]["capped_search_time"].value, -estimates[k]["success_rate"].value),
    )
    named = [labels.index(label) for label in references if label in labels]
    chosen = named or [best]
    against = _all_against([result.records for result in results], chosen)
    rows = (
        Row(result, estimates[k], k == best, {labels[r]: against[k, r] for r in chosen if r != k})
        for k, result in enumerate(results)
    )
    return Group(scenario, value, tuple(rows), tuple(labels[r] for r in chosen), picked=not named)


def _all_against(records: Sequence[EpisodeRecords], references: Sequence[int]) -> dict[tuple[int, int], Against]:
    """(policy, reference) -> the comparison; two references are compared, and counted by Holm's correction, once."""
    pairs = [
        (k, r)
        for place, r in enumerate(references)
        for k in range(len(records))
        if k != r and k not in references[:place]
    ]
    found = [_against(records[k], records[r]) for k, r in pairs]
    times = holm([one.search_time.p_value for one in found])
    rates = holm([one.success_rate.p_value for one in found])
    against = {}
    for pair, one, time_p, rate_p in zip(pairs, found, times, rates, strict=True):
        against[pair] = one.corrected(time_p, rate_p)
        against[pair[::-1]] = against[pair].mirrored()
    return against


def _against(records: EpisodeRecords, reference: EpisodeRecords) -> Against:
    mine, theirs = records.common_seeds(reference)
    times, reference_times = (pair.values("capped_search_time") for pair in (mine, theirs))
    return Against(
        compare_paired(times, reference_times),
        compare_successes(mine.values("success_rate"), theirs.values("success_rate")),
        bootstrap_mean(wins(reference_times, times)),
        wilcoxon(times, reference_times) if times.size else float("nan"),
    )


def _negative(comparison: Comparison) -> Comparison:
    value, low, high = comparison.difference
    return comparison._replace(difference=Estimate(-value, -high, -low))


def wide(groups: Iterable[Group]) -> list[dict[str, Any]]:
    """Every row with every measure and its interval as plain values, SI units: the lines of the CSV and JSON tables."""
    lines = []
    for group in groups:
        for row in group.rows:
            cell = row.result.case.cell
            line: dict[str, Any] = {
                "scenario": group.scenario,
                "value": group.value,
                "policy": row.label,
                "scenario_hash": cell.scenario.hash,
                "success_rule": cell.scenario.ending.success,
                "clock": cell.scenario.clock,
                "n_uavs": cell.scenario.team.n_uavs,
                "first_seed": cell.seeds[0],
                "episodes": len(cell.seeds),
            }
            for measure, estimate in row.estimates.items():
                line |= _spread(measure, estimate)
            line["best"] = row.best
            lines.append(_without_nan(line))
    return lines


def comparisons(groups: Iterable[Group]) -> list[dict[str, Any]]:
    """Every policy against every reference as plain values, SI units: differences are policy minus reference."""
    return [
        _without_nan(
            {
                "scenario": group.scenario,
                "value": group.value,
                "policy": row.label,
                "reference": reference,
                "pairs": against.search_time.pairs,
                **_spread("search_time_difference", against.search_time.difference),
                "search_time_p_holm": against.search_time.p_value,
                "search_time_p_wilcoxon": against.wilcoxon_p,
                **_spread("success_rate_difference", against.success_rate.difference),
                "success_rate_p_holm": against.success_rate.p_value,
                **_spread("reference_faster", against.reference_faster),
            }
        )
        for group in groups
        for row in group.rows
        for reference, against in row.against.items()
    ]


def _spread(name: str, estimate: Estimate) -> dict[str, float]:
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def _without_nan(line: dict[str, Any]) -> dict[str, Any]:
    return {key: None if value != value else value for key, value in line.items()}


def wide_frame(groups: Iterable[Group]) -> pd.DataFrame:
    """`wide` as a table."""
    import pandas as pd

    return pd.DataFrame(wide(groups))


def comparisons_frame(groups: Iterable[Group]) -> pd.DataFrame:
    """`comparisons` as a table."""
    import pandas as pd

    return pd.DataFrame(comparisons(groups))


def episodes_frame(results: Iterable[Result]) -> pd.DataFrame:
    """Every episode of every case, under the case's labels."""
    import pandas as pd

    frames = []
    for result in results:
        frame = result.records.to_frame()
        labels = {
            "scenario_label": result.case.scenario,
            "policy_label": result.case.policy,
            "value": result.case.value,
        }
        frames.append(frame.assign(**labels))
    return pd.concat(frames, ignore_index=True)
