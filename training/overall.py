"""All scenarios of a benchmark together, in the way of rliable (Agarwal et al. 2021): scenarios are tasks, seeds runs.

Only of policies that flew the same number of episodes in every scenario: each scenario weighs the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from osl_env.parameters import FloatArray
from training.comparison import Group, Row
from training.statistics import (
    Estimate,
    Profile,
    aggregates,
    performance_profile,
    stratified_mean,
    wins,
)

_THRESHOLDS = 241  # of a performance profile: every 5 s up to the papers' 20 min


@dataclass(frozen=True)
class Overall:
    """One policy over all scenarios. Times are capped search times, s."""

    label: str
    episodes: int  # a scenario
    search_time: dict[str, Estimate]  # by the names of `training.statistics.AGGREGATES`
    success_rate: Estimate  # mean over the scenarios
    reference_faster: dict[str, Estimate]  # by reference: share of the common seeds, mean over the scenarios


def _complete(groups: Sequence[Group]) -> dict[str, list[Row]]:
    """Label -> its rows, one a group, of the policies that are in the overall table."""
    rows: dict[str, list[Row]] = {}
    for group in groups:
        for row in group.rows:
            rows.setdefault(row.label, []).append(row)
    return {
        label: found
        for label, found in rows.items()
        if len(found) == len(groups) and len({len(row.result.records) for row in found}) == 1
    }


def over_all(groups: Sequence[Group]) -> list[Overall]:
    """The policies, the least interquartile mean of the capped search time first."""
    complete = _complete(groups)
    named = {group.references for group in groups}
    references = groups[0].references if len(named) == 1 else ()  # a best policy of one scenario only tells nothing
    found = [
        Overall(
            label=label,
            episodes=len(rows[0].result.records),
            search_time=aggregates(_matrix(rows, "capped_search_time")),
            success_rate=aggregates(_matrix(rows, "success_rate"))["mean"],
            reference_faster={
                reference: _faster(complete[reference], rows)
                for reference in references
                if reference != label and reference in complete
            },
        )
        for label, rows in complete.items()
    ]
    return sorted(found, key=lambda one: one.search_time["interquartile_mean"].value)


def _matrix(rows: Sequence[Row], measure: str) -> FloatArray:
    """(episodes, scenarios)."""
    return np.stack([row.result.records.values(measure) for row in rows], axis=1)


def _faster(reference: Sequence[Row], rows: Sequence[Row]) -> Estimate:
    shares = []
    for theirs, mine in zip(reference, rows, strict=True):
        pairs = theirs.result.records.common_seeds(mine.result.records)
        shares.append(wins(*(records.values("capped_search_time") for records in pairs)))
    return stratified_mean(shares)


class Profiles(NamedTuple):
    """Performance profiles over all scenarios."""

    thresholds: FloatArray  # (m,) s
    of: dict[str, Profile]  # by policy, the greatest area under the profile first


def profiles(groups: Sequence[Group]) -> Profiles:
    """Each policy's share of episodes with a search time below each threshold; a failure is below none."""
    complete = _complete(groups)
    limit = max(
        (row.result.case.cell.scenario.ending.time_limit for rows in complete.values() for row in rows), default=0.0
    )
    thresholds = np.linspace(0.0, limit, _THRESHOLDS)
    found = {}
    for label, rows in complete.items():
        times = [
            np.where(
                row.result.records.values("success_rate") > 0, row.result.records.values("capped_search_time"), np.inf
            )
            for row in rows
        ]
        found[label] = performance_profile(times, thresholds)
    order = sorted(found, key=lambda label: -float(found[label].share.mean()))
    return Profiles(thresholds, {label: found[label] for label in order})
