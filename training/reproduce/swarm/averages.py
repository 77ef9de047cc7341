"""Averages over settings, with bootstrap intervals that keep what the runs have in common.

A world, a layout with a seed, has one wind whatever is flown in it. So whole worlds are resampled, within each layout:
a drawn world brings its runs of all policies, teams and emissions with it. Layouts weigh the same within a setting,
and settings within an average. Layouts themselves are not resampled: an interval is for these layouts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from osl_env.parameters import FloatArray
from training.reproduce.swarm.runs import Flown, Setting
from training.resampling import RESAMPLES
from training.statistics import CONFIDENCE, NOTHING, Estimate

CAPPED_TIME, SUCCESS = "capped_search_time", "success_rate"

World = tuple[str, tuple[int, ...]]  # layout, seeds


class Mean(NamedTuple):
    """An average, and what it is in each resample."""

    value: float
    draws: FloatArray  # (RESAMPLES,)

    @property
    def estimate(self) -> Estimate:
        """With its percentile interval; resamples in which it is not defined are left out."""
        if math.isnan(self.value):
            return NOTHING
        if np.isnan(self.draws).all():
            return Estimate(self.value, math.nan, math.nan)
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = np.nanquantile(self.draws, (tail, 1.0 - tail))
        return Estimate(self.value, float(low), float(high))


class Pool:
    """All runs of an experiment."""

    def __init__(self, flown: Sequence[Flown]) -> None:
        """Draw the worlds: one draw for all settings that share them."""
        self.flown = {one.setting: one for one in flown}
        names = dict.fromkeys(self._world(one, k) for one in flown for k in range(len(one.layouts)))
        self._counts = {
            world: np.random.default_rng(number).multinomial(
                len(world[1]), np.full(len(world[1]), 1 / len(world[1])), size=RESAMPLES
            )
            for number, world in enumerate(names)
        }

    @staticmethod
    def _world(one: Flown, layout: int) -> World:
        result = one.layouts[layout]
        return result.case.cell.scenario.name, tuple(record.seed for record in result.records)

    def mean(self, settings: Sequence[Setting], measure: str = CAPPED_TIME) -> Mean:
        """Mean over `settings` of the mean over their layouts of the mean over their runs; NaN without any."""
        return self._average(settings, lambda setting, layout: self.values(setting, layout, measure))

    def where_both_succeed(self, settings: Sequence[Setting], others: Sequence[Setting]) -> tuple[Mean, Mean]:
        """Search time a run of `settings` and of `others`, as many, both 0 in the worlds where either fails.

        Their ratio is that of the times where both succeed; NaN without such a world.
        """
        partner = dict(zip(settings, others, strict=True))

        def both(setting: Setting, layout: int) -> FloatArray:
            return self.values(setting, layout, SUCCESS) * self.values(partner[setting], layout, SUCCESS)

        def theirs(setting: Setting, layout: int) -> FloatArray:
            return self.values(partner[setting], layout, CAPPED_TIME) * both(setting, layout)

        def ours(setting: Setting, layout: int) -> FloatArray:
            return self.values(setting, layout, CAPPED_TIME) * both(setting, layout)

        return self._average(settings, ours), self._average(settings, theirs)

    def values(self, setting: Setting, layout: int, measure: str) -> FloatArray:
        """(n,) of the runs in one layout."""
        return self.flown[setting].layouts[layout].records.values(measure)

    def _average(self, settings: Sequence[Setting], figures_of: Callable[[Setting, int], FloatArray]) -> Mean:
        total, draws, repeated = 0.0, np.zeros(RESAMPLES), False
        for setting in settings:
            n_layouts = len(self.flown[setting].layouts)
            for layout in range(n_layouts):
                figures = figures_of(setting, layout)
                total += float(figures.mean()) / n_layouts
                draws += self._counts[self._world(self.flown[setting], layout)] @ figures / (figures.size * n_layouts)
                repeated |= figures.size > 1
        if not repeated:  # single runs have no interval
            draws[:] = np.nan
        return Mean(total / len(settings) if settings else math.nan, draws / max(len(settings), 1))

    def where(
        self,
        policy: str,
        n_robots: int | None = None,
        obstacles: int | None = None,
        emission: float | None = None,
    ) -> list[Setting]:
        """The settings flown with these; None: any."""
        return [
            setting
            for setting in self.flown
            if setting.policy == policy
            and n_robots in (None, setting.n_robots)
            and obstacles in (None, setting.obstacles)
            and (emission is None or math.isclose(emission, setting.emission))
        ]


def ratio(over: Mean, under: Mean) -> Estimate:
    """`over` by `under`; nothing where that is 0."""
    return _quotient(over, under).estimate


def ratio_of_ratios(first: tuple[Mean, Mean], second: tuple[Mean, Mean]) -> Estimate:
    """The ratio of `first` by the ratio of `second`."""
    return _quotient(_quotient(*first), _quotient(*second)).estimate


def difference(first: Mean, second: Mean) -> Estimate:
    """`first` less `second`."""
    return Mean(first.value - second.value, first.draws - second.draws).estimate


def _quotient(over: Mean, under: Mean) -> Mean:
    draws = np.divide(over.draws, under.draws, out=np.full(RESAMPLES, np.nan), where=under.draws > 0.0)
    return Mean(over.value / under.value if under.value > 0.0 else math.nan, draws)
