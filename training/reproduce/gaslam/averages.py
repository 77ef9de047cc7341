"""The paper's averages of runs, with intervals: over the runs of a case that have not failed.

Intervals of means are bootstrapped over the runs (BCa). M is computed from a case's averages (14), so its interval
comes from resampling whole runs, each with its SC, RMSE and PE (percentiles). What holds for all cases together is the
mean of the cases' means, resampled within each case.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from osl_env.parameters import FloatArray
from training.gas_mapping import merit
from training.reproduce.gaslam.published import published
from training.reproduce.gaslam.runs import Flown
from training.resampling import RESAMPLES
from training.statistics import CONFIDENCE, NOTHING, Estimate, bootstrap_mean, stratified_mean, wilson

MEASURES = ("rmse", "rmse_ste", "sc", "pe", "m")  # the columns of table II
LESS_IS_BETTER = {"rmse": True, "rmse_ste": True, "sc": False, "pe": True, "m": False}
EMPTY = {"rmse": "empty_rmse", "sc": "empty_sc"}  # of the map "no gas anywhere"; it places no source


def estimate(flown: Flown, measure: str) -> Estimate:
    """`measure` of the runs that have not failed; nothing if all have."""
    return _merit(flown) if measure == "m" else bootstrap_mean(flown.values(measure))


def empty_estimate(flown: Flown, measure: str) -> Estimate:
    """`measure` of the map "no gas anywhere" in all episodes of `flown`, of which it fails none; nothing without."""
    if measure not in EMPTY:
        return NOTHING
    return bootstrap_mean([getattr(run, EMPTY[measure]) for run in flown.runs])


def ratio(flown: Flown, measure: str) -> Estimate:
    """Ours over the paper's; nothing where that is not known."""
    paper = published(flown.name, measure)
    return Estimate(*(value / paper for value in estimate(flown, measure)))


def _merit(flown: Flown) -> Estimate:
    figures = np.stack([flown.values(measure) for measure in ("sc", "rmse", "pe")])  # (3, n)
    n = figures.shape[1]
    if n == 0:
        return NOTHING
    value = merit(*figures.mean(axis=1).tolist())
    if n == 1:
        return Estimate(value, math.nan, math.nan)
    drawn = np.random.default_rng(0).integers(n, size=(RESAMPLES, n))
    sc, rmse, pe = figures[:, drawn].mean(axis=2)
    with np.errstate(divide="ignore"):
        tail = (1.0 - CONFIDENCE) / 2.0
        low, high = np.quantile(sc * np.abs(1.0 - rmse) / pe, (tail, 1.0 - tail))
    return Estimate(value, float(low), float(high))


def over_cases(flown: Sequence[Flown], measure: str) -> Estimate:
    """Mean of the cases' means of a measure of single runs."""
    return mean_of_means([_known(one.values(measure)) for one in flown])


def mean_of_means(samples: Sequence[FloatArray]) -> Estimate:
    """Mean of the means of `samples` (n_k,), resampled within each; no interval where each is a single run."""
    pooled = stratified_mean(samples)
    return pooled if any(sample.size > 1 for sample in samples) else Estimate(pooled.value, math.nan, math.nan)


def succeeded(flown: Sequence[Flown]) -> Estimate:
    """Share of all runs that have not failed, with Wilson's interval."""
    return wilson(sum(len(one.kept) for one in flown), sum(len(one.runs) for one in flown))


def difference(flown: Sequence[Flown], others: Sequence[Flown], measure: str) -> Estimate:
    """Mean over the cases of `measure` less that of `others` on the same seeds, over all runs that have one.

    Failed runs count, for leaving them out would flatter the setting that fails more.
    """
    return mean_of_means([paired(one, other, measure, measure) for one, other in zip(flown, others, strict=True)])


def paired(flown: Flown, other: Flown, measure: str, measure_of_other: str) -> FloatArray:
    """(n,) differences, seed by seed, where both exist."""
    theirs = {run.seed: getattr(run, measure_of_other) for run in other.runs}
    pairs = [getattr(run, measure) - theirs[run.seed] for run in flown.runs if run.seed in theirs]
    return _known(np.array(pairs, dtype=np.float64))


def _known(values: FloatArray) -> FloatArray:
    return values[~np.isnan(values)]


def by_setting(flown: Sequence[Flown]) -> dict[str, list[Flown]]:
    """The cases of each setting, in their order."""
    settings = dict.fromkeys(one.setting for one in flown)
    return {setting: [one for one in flown if one.setting == setting] for setting in settings}


def by_case(flown: Sequence[Flown]) -> dict[str, list[Flown]]:
    """The settings of each case, in their order."""
    names = dict.fromkeys(one.name for one in flown)
    return {name: [one for one in flown if one.name == name] for name in names}
