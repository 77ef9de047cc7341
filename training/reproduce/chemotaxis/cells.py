"""One cell of the paper's tables, source x start in one setting, flown once a seed: statistics beside the paper's.

Flight times are of successes, as the paper's are; failures are counted and their ending is named, they never enter a
time. The first seed is the pinned one, fixed beforehand as the benchmark's seeds are.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from osl_env.errors import InputError
from osl_env.parameters import FloatArray
from osl_env.record import EpisodeRecord
from training.benchmark import Benchmark, load_benchmark
from training.records import EpisodeRecords
from training.reproduce.chemotaxis.published import FLIGHT_TIMES, N_STARTS, flight_time
from training.statistics import NOTHING, Estimate, bootstrap_mean, stratified_mean
from training.store import Store
from training.sweep import Cell, run_cells

BASE = "base"  # the setting of the paper's tables
_STARTS = {f"Initial {start}": start for start in range(1, N_STARTS + 1)}
_SPREAD = (0.1, 0.9)  # quantiles shown as the spread over the seeds


@dataclass(frozen=True)
class Part:
    """A benchmark of one source whose scenarios are labelled by the start; its policies' labels name the settings.

    `base`: the policy's label is replaced by BASE, and the paper's times stand beside ours.
    """

    benchmark: str
    source: int
    base: bool = True


@dataclass(frozen=True)
class FlownCell:
    """All flights of one cell."""

    source: int
    start: int
    setting: str
    cell: Cell
    records: EpisodeRecords  # in the order of the seeds

    @property
    def name(self) -> str:
        """`Source 1 / Initial 2`, with the setting if it is not the paper's base."""
        place = f"Source {self.source} / Initial {self.start}"
        return place if self.setting == BASE else f"{place}, {self.setting}"

    @property
    def paper(self) -> float:
        """The published flight time, s; NaN where the paper prints none."""
        return flight_time(self.source, self.start) if self.setting == BASE else math.nan

    @property
    def times(self) -> FloatArray:
        """(n_successes,) flight times, s."""
        return np.array([record.search_time for record in self.records if record.success], dtype=np.float64)

    @property
    def n_successes(self) -> int:
        """Of all flights."""
        return sum(record.success for record in self.records)

    @property
    def success(self) -> Estimate:
        """Share of the flights, with Wilson's interval."""
        return self.records.estimate("success_rate")

    @property
    def mean(self) -> Estimate:
        """Flight time, s, with its bootstrap interval over the seeds."""
        return bootstrap_mean(self.times)

    @property
    def median(self) -> float:
        """Flight time, s; NaN without a success."""
        return float(np.median(self.times)) if self.n_successes else math.nan

    @property
    def spread(self) -> tuple[float, float]:
        """10 and 90 % quantiles of the flight time, s; NaN without a success."""
        return _quantiles(self.times)

    @property
    def ratio(self) -> Estimate:
        """Our mean flight time over the paper's, with its bootstrap interval over the seeds."""
        return Estimate(*(value / self.paper for value in self.mean)) if self.setting == BASE else NOTHING

    @property
    def pinned(self) -> EpisodeRecord:
        """The flight with the first seed."""
        return self.records[0]

    @property
    def pinned_time(self) -> float:
        """s; NaN if the pinned flight failed."""
        return self.pinned.search_time if self.pinned.success else math.nan

    @property
    def detection_times(self) -> FloatArray:
        """(n_flights,) first reading over the sensor's threshold, s; NaN where there was none."""
        return self.records.values("first_detection_time")

    @property
    def detection(self) -> float:
        """Median time of the first detection, s, where a flight without one never detects: infinite then."""
        return float(np.median(np.nan_to_num(self.detection_times, nan=math.inf)))

    @property
    def detection_spread(self) -> tuple[float, float]:
        """10 and 90 % quantiles of the first detection over the flights that have one, s."""
        return _quantiles(self.detection_times[~np.isnan(self.detection_times)])

    @property
    def failures(self) -> str:
        """How the failed flights ended: `2 out of bounds, 1 time`; empty without."""
        counts = Counter(record.ended for record in self.records if not record.success)
        return ", ".join(f"{count} {ending.replace('_', ' ')}" for ending, count in counts.most_common())


def _quantiles(values: FloatArray) -> tuple[float, float]:
    if values.size == 0:
        return math.nan, math.nan
    low, high = np.quantile(values, _SPREAD)
    return float(low), float(high)


def mean_over_starts(cells: Sequence[FlownCell]) -> Estimate:
    """Mean of the cells' mean flight times, s, resampled within each cell; nothing if a cell has no success."""
    samples = [cell.times for cell in cells]
    return stratified_mean(samples) if all(sample.size for sample in samples) else NOTHING


def ratio_of_means(cells: Sequence[FlownCell]) -> Estimate:
    """`mean_over_starts` over the mean of the paper's times."""
    paper = float(np.mean([cell.paper for cell in cells]))
    return Estimate(*(value / paper for value in mean_over_starts(cells)))


def difference_of_means(cells: Sequence[FlownCell], others: Sequence[FlownCell]) -> Estimate:
    """Mean flight time of `cells` less that of `others`, as many, s, resampled within each cell.

    Nothing if a cell has no success.
    """
    ours, theirs = [cell.times for cell in cells], [cell.times for cell in others]
    if not all(sample.size for sample in (*ours, *theirs)):
        return NOTHING
    # the mean over both groups together, one of them negative, is half the difference
    return stratified_mean([*(2.0 * sample for sample in ours), *(-2.0 * sample for sample in theirs)])


def capped_mean(cells: Sequence[FlownCell]) -> float:
    """Mean over cells and flights of the flight time, s, a failure counting as the time limit."""
    return float(np.mean([cell.records.values("capped_search_time").mean() for cell in cells]))


def load_part(part: Part, episodes: int | None, first_seed: int | None) -> Benchmark:
    """The benchmark of `part`, limited. Raises InputError if its labels are not the starts."""
    benchmark = load_benchmark(part.benchmark).limited(episodes, first_seed)
    labels = [entry.label for entry in benchmark.scenarios]
    if unknown := [label for label in labels if label not in _STARTS]:
        raise InputError(f"{part.benchmark}: scenarios: label {unknown[0]!r} must be one of {', '.join(_STARTS)}")
    return benchmark


class Planned(NamedTuple):
    """A cell that has not been flown yet."""

    source: int
    start: int
    setting: str
    cell: Cell

    def flown(self, records: EpisodeRecords) -> FlownCell:
        """With its flights."""
        return FlownCell(*self, records)


def planned_cells(parts: Sequence[Part], episodes: int | None = None, first_seed: int | None = None) -> list[Planned]:
    """The cells of `parts` with at most `episodes` seeds each. Raises InputError for a benchmark that does not fit."""
    return [
        Planned(part.source, _STARTS[case.scenario], BASE if part.base else case.policy, case.cell)
        for part in parts
        for case in load_part(part, episodes, first_seed).cases()
    ]


def fly_parts(
    parts: Sequence[Part],
    *,
    episodes: int | None,
    first_seed: int | None,
    n_jobs: int | None,
    store: Store | None,
    progress: bool | None,
) -> list[FlownCell]:
    """All cells of `parts`, flown together over all processes. Arguments as for `training.evaluate`."""
    wanted = planned_cells(parts, episodes, first_seed)
    records = run_cells([one.cell for one in wanted], n_jobs=n_jobs, store=store, progress=progress)
    return [one.flown(found) for one, found in zip(wanted, records, strict=True)]


def by_source(cells: Sequence[FlownCell]) -> dict[int, list[FlownCell]]:
    """The cells of each source."""
    return {source: [cell for cell in cells if cell.source == source] for source in FLIGHT_TIMES}


def by_setting(cells: Sequence[FlownCell]) -> dict[str, list[FlownCell]]:
    """The cells of each setting, in their order."""
    settings = dict.fromkeys(cell.setting for cell in cells)
    return {setting: [cell for cell in cells if cell.setting == setting] for setting in settings}
