"""What the paper claims of its fifteen flights, as something that our flights can confirm, contradict or leave open.

The search phase is chaotic, so no claim is about the time of a single cell that searches long. Claims that begin with
"(ours)" are not the paper's: they are what held over all plausible readings of it, fixed before the figures were made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from training.report import number, with_interval
from training.reproduce.chemotaxis import published
from training.reproduce.chemotaxis.cells import (
    FlownCell,
    by_setting,
    by_source,
    capped_mean,
    difference_of_means,
    mean_over_starts,
)
from training.reproduce.chemotaxis.tracks import fly_track
from training.reproduce.claims import Finding, Verdict
from training.statistics import Estimate, wilson

_LAYER = 0.25  # m: a flight is in a scan layer if it is not farther from its height
_SWEPT = 20.0  # m by m: what must be covered for "nothing in this layer" to mean something; the area is 30 x 30
_CLIMB_TIME = 0.1  # relative: how near the detection after the climb must be to the published time


class CellClaim(Protocol):
    """Something that flown cells can decide."""

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """The verdict, with figures."""


@dataclass(frozen=True)
class PinnedFlightsSucceed:
    """Every cell succeeds on the first seed, as each of the paper's single flights did."""

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """One failure contradicts."""
        failed = [f"{cell.name} ({_ended(cell)})" for cell in cells if not cell.pinned.success]
        ours = f"seed {cells[0].pinned.seed}: {len(cells) - len(failed)} of {len(cells)}{_but('failed', failed)}"
        return Finding(f"All {len(cells)} flights reach the source", "contradicted" if failed else "holds", ours)


@dataclass(frozen=True)
class CellsAlwaysSucceed:
    """At least `least` cells succeed for every seed."""

    least: int

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """A count."""
        failing = [f"{cell.name} ({cell.failures})" for cell in cells if cell.failures]
        always = len(cells) - len(failing)
        claim = f"(ours) At least {self.least} of {len(cells)} cells succeed for every one of {_seeds(cells)}"
        ours = f"{always} of {len(cells)}{_but('failures', failing)}"
        return Finding(claim, "holds" if always >= self.least else "contradicted", ours)


@dataclass(frozen=True)
class FlightsSucceed:
    """The success rate over all cells is at least `rate`, in every setting if there are several."""

    rate: float

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """Wilson's interval of the pooled flights lies above, below or across the rate."""
        verdicts, figures = [], []
        for setting, members in by_setting(cells).items():
            trials = sum(len(cell.records) for cell in members)
            pooled = wilson(sum(cell.n_successes for cell in members), trials)
            verdicts.append(_side(Estimate(*(value - self.rate for value in pooled))))
            label = f"{setting}: " if len(by_setting(cells)) > 1 else ""
            figures.append(f"{label}{with_interval(pooled, 100, 1)} % of {trials}")
        claim = f"(ours) {self.rate * 100:g} % and more of the flights succeed"
        return Finding(claim, _worst(verdicts), "; ".join(figures))


@dataclass(frozen=True)
class SourcesInOrder:
    """The mean flight time over the starts rises in the order of `sources`."""

    sources: tuple[int, ...] = (2, 3, 1)

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """Each difference of neighbours has its interval above zero."""
        groups = by_source(cells)
        pairs = list(zip(self.sources, self.sources[1:], strict=False))
        differences = [difference_of_means(groups[later], groups[earlier]) for earlier, later in pairs]
        means = ", ".join(f"Source {source} {_mean(groups[source])} s" for source in self.sources)
        steps = ", ".join(
            f"{later} - {earlier}: {with_interval(difference)} s"
            for (earlier, later), difference in zip(pairs, differences, strict=True)
        )
        capped = ", ".join(f"{source}: {capped_mean(groups[source]):.1f}" for source in self.sources)
        claim = "Mean flight time: " + " < ".join(f"Source {source}" for source in self.sources)
        limit = cells[0].cell.scenario.ending.time_limit
        ours = f"{means}; {steps}; failures counted as {limit:g} s: {capped}"
        return Finding(claim, _worst([_side(difference) for difference in differences]), ours)


@dataclass(frozen=True)
class MostDetectWithin:
    """More than half of the cells have their first detection (median over the seeds) within `limit`, s."""

    limit: float

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """A count."""
        later = [f"{cell.name} {number(cell.detection)} s" for cell in cells if cell.detection > self.limit]
        soon = len(cells) - len(later)
        claim = f"(ours) Most cells detect within {self.limit:g} s"
        return Finding(
            claim, "holds" if 2 * soon > len(cells) else "contradicted", f"{soon} of {len(cells)}{_but('later', later)}"
        )


@dataclass(frozen=True)
class DetectsAfterClimb:
    """The described flight meets no gas in its first layer and detects after climbing one."""

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """The pinned flight, watched: the height of its first detection."""
        cell = _climbing(cells)
        track = fly_track(cell.cell, cell.pinned.seed)
        height, wanted = track.detection_height, published.CLIMB_DETECTION_HEIGHT
        before = track.positions[: np.argmax(track.detected) if track.detected.any() else None]
        low = before[np.abs(before[:, 2] - published.CLIMB_START_HEIGHT) <= _LAYER]
        claim = (
            f"{cell.name}: nothing is detected in the {published.CLIMB_START_HEIGHT:g} m layer; "
            f"it climbs to {wanted:g} m and detects there"
        )
        swept = np.ptp(low[:, :2], axis=0) if len(low) else np.zeros(2)
        ours = (
            f"seed {cell.pinned.seed}: {swept[0]:.0f} m x {swept[1]:.0f} m swept in that layer, "
            f"first detection at {number(height, 2)} m"
        )
        as_told = swept.min() >= _SWEPT and abs(height - wanted) <= _LAYER
        return Finding(claim, "holds" if as_told else "contradicted", ours)


@dataclass(frozen=True)
class DetectsAtPublishedTime:
    """The described flight's first detection is near the published time."""

    def check(self, cells: Sequence[FlownCell]) -> Finding:
        """The median over the seeds."""
        cell = _climbing(cells)
        wanted, ours = published.CLIMB_DETECTION_TIME, cell.detection
        low, high = cell.detection_spread
        claim = f"{cell.name}: the first detection comes at {wanted:g} s (here: within {_CLIMB_TIME * 100:g} %)"
        figures = f"median {number(ours, 2)} s, 10-90 % {number(low, 2)} to {number(high, 2)} s over {_seeds(cells)}"
        return Finding(claim, "holds" if abs(ours / wanted - 1.0) <= _CLIMB_TIME else "contradicted", figures)


def _climbing(cells: Sequence[FlownCell]) -> FlownCell:
    for cell in cells:
        if (cell.source, cell.start) == published.CLIMB_CELL:
            return cell
    raise LookupError(f"no cell is {published.CLIMB_CELL}")


def _seeds(cells: Sequence[FlownCell]) -> str:
    count = len(cells[0].records)
    return f"{count} seed{'s' * (count > 1)}"


def _ended(cell: FlownCell) -> str:
    return cell.pinned.ended.replace("_", " ")


def _but(what: str, names: Sequence[str]) -> str:
    return f"; {what}: {', '.join(names)}" if names else ""


def _mean(cells: Sequence[FlownCell]) -> str:
    return with_interval(mean_over_starts(cells))


def _side(difference: Estimate) -> Verdict:
    if difference.low > 0:
        return "holds"
    return "contradicted" if difference.high < 0 else "open"  # NaN, where there is nothing to compare, is open


def _worst(verdicts: Sequence[Verdict]) -> Verdict:
    order: tuple[Verdict, ...] = ("contradicted", "open", "holds")
    return min(verdicts, key=order.index)
