"""Results side by side: each policy's estimates, and its paired difference from the best one on the same seeds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from training.benchmark import Result
from training.statistics import (
    NOTHING,
    Comparison,
    Estimate,
    compare_paired,
    holm,
    stratified_interquartile_mean,
    wilcoxon,
)

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Row:
    """One line of a table. `against_best` is None for the best policy itself."""

    result: Result
    estimates: dict[str, Estimate]  # SI units; see EpisodeRecords.summary
    against_best: Comparison | None  # difference of the capped search times, s; p corrected by Holm over the group
    wilcoxon_p: float  # uncorrected; NaN for the best

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


def grouped(results: Iterable[Result]) -> list[Group]:
    """The results by scenario and swept value, each group compared with its best policy.

    The best has the least capped mean search time, then the higher success rate. Picked from the same episodes, it is
    best by luck in part: the p values say how far the others are from it, not that it would win again.
    """
    groups: dict[tuple[str, float | None], list[Result]] = {}
    for result in results:
        groups.setdefault((result.case.scenario, result.case.value), []).append(result)
    return [Group(scenario, value, _compared(members)) for (scenario, value), members in groups.items()]


def _compared(results: list[Result]) -> tuple[Row, ...]:
    estimates = [result.records.summary() for result in results]
    order = sorted(
        range(len(results)),
        key=lambda k: (estimates[k]["capped_search_time"].value, -estimates[k]["success_rate"].value),
    )
    best = results[order[0]].records
    comparisons: list[Comparison] = []
    signed_rank = []
    for result in results:
        mine, theirs = (pair.values("capped_search_time") for pair in result.records.common_seeds(best))
        comparisons.append(compare_paired(mine, theirs))
        signed_rank.append(wilcoxon(mine, theirs) if mine.size else float("nan"))
    tested = [float("nan") if k == order[0] else comparison.p_value for k, comparison in enumerate(comparisons)]
    return tuple(
        Row(
            result,
            estimates[k],
            None if k == order[0] else comparisons[k]._replace(p_value=adjusted),
            float("nan") if k == order[0] else signed_rank[k],
        )
        for k, (result, adjusted) in enumerate(zip(results, holm(tested), strict=True))
    )


def over_all(groups: Sequence[Group]) -> dict[str, Estimate]:
    """Policy -> interquartile mean of its capped search times, s, over the scenarios (tasks) and seeds (runs).

    Only of policies that flew the same number of episodes in every scenario.
    """
    estimates = {}
    for label in dict.fromkeys(row.label for group in groups for row in group.rows):
        times = [
            row.result.records.values("capped_search_time")
            for group in groups
            for row in group.rows
            if row.label == label
        ]
        if len(times) == len(groups) and len({column.size for column in times}) == 1:
            estimates[label] = stratified_interquartile_mean(np.stack(times, axis=1))
    return estimates


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
                line |= {measure: estimate.value, f"{measure}_low": estimate.low, f"{measure}_high": estimate.high}
            against = row.against_best or Comparison(NOTHING, float("nan"), 0)
            line |= {
                "best": row.against_best is None,
                "difference_from_best": against.difference.value,
                "difference_from_best_low": against.difference.low,
                "difference_from_best_high": against.difference.high,
                "p_holm": against.p_value,
                "p_wilcoxon": row.wilcoxon_p,
                "pairs": against.pairs,
            }
            lines.append({key: None if value != value else value for key, value in line.items()})
    return lines


def wide_frame(groups: Iterable[Group]) -> pd.DataFrame:
    """`wide` as a table."""
    import pandas as pd

    return pd.DataFrame(wide(groups))


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
