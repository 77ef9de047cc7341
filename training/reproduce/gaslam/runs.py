"""Runs of policies that map the gas: flown, with the maps at their end and the true one.

A case of the paper is a scenario; what is flown in it, a policy, is a setting. Runs are not kept in a store, which has
no place for maps: a repeated command flies them again.
"""

from __future__ import annotations

import functools
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from joblib import Parallel, delayed, parallel_config
from tqdm import tqdm

from baselines.gaslam.cells import Cells
from osl_env.parameters import FloatArray
from osl_env.record import EpisodeRecord
from osl_env.scenario import Scenario
from training.benchmark import Case, load_benchmark
from training.flight import fly
from training.gas_mapping import is_failed, position_error, rmse, shape_coverage, true_mean_map
from training.reproduce.gaslam.mapped import GasMaps, maps_of
from training.sweep import check_jobs

Item = TypeVar("Item")
Product = TypeVar("Product")


@dataclass(frozen=True, eq=False)
class Landed:
    """A flight that is over, and what its UAV then believed."""

    record: EpisodeRecord
    source: FloatArray  # (3,) m
    declared: FloatArray | None  # (3,) m
    maps: GasMaps
    track: FloatArray  # (m, 3) m, of UAV 0, a row a decision, the start first; at rest once it is over


@dataclass(frozen=True, eq=False)
class Run:
    """A flight beside the truth. Figures that do not exist, for want of a declaration or a map, are NaN."""

    landed: Landed
    truth: FloatArray  # (n,) time-averaged concentration in the cells of the maps
    floor: float  # concentration up to which nothing is gas

    @property
    def seed(self) -> int:
        """Of the episode."""
        return self.landed.record.seed

    @property
    def offset(self) -> FloatArray:
        """(3,) m from the source to the declared place."""
        return np.full(3, np.nan) if self.landed.declared is None else self.landed.declared - self.landed.source

    @property
    def pe(self) -> float:
        """Position error (11), m."""
        declared = self.landed.declared
        return np.nan if declared is None else position_error(declared, self.landed.source)

    @property
    def failed(self) -> bool:
        """Whether the run is left out of the averages: an error along x over 5 m, or no declaration at all."""
        return self.landed.declared is None or is_failed(self.landed.declared, self.landed.source)

    @functools.cached_property
    def rmse(self) -> float:
        """Of the final map (12)."""
        return rmse(self.landed.maps.final, self.truth)

    @functools.cached_property
    def rmse_ste(self) -> float:
        """Of the map of the source term (12)."""
        return np.nan if self.landed.maps.plume is None else rmse(self.landed.maps.plume, self.truth)

    @functools.cached_property
    def sc(self) -> float:
        """Shape coverage of the final map (13)."""
        return shape_coverage(self.landed.maps.final, self.truth, self.floor)

    @functools.cached_property
    def empty_rmse(self) -> float:
        """Of the map "no gas anywhere"."""
        return rmse(np.zeros_like(self.truth), self.truth)

    @functools.cached_property
    def empty_sc(self) -> float:
        """Of the map "no gas anywhere"."""
        return shape_coverage(np.zeros_like(self.truth), self.truth, self.floor)


class Flown(NamedTuple):
    """All runs of one setting in one case, in the order of the seeds."""

    case: Case
    runs: tuple[Run, ...]

    @property
    def name(self) -> str:
        """Of the paper's case."""
        return self.case.scenario

    @property
    def setting(self) -> str:
        """What was flown."""
        return self.case.policy

    @property
    def kept(self) -> list[Run]:
        """The runs that have not failed: those of the averages."""
        return [run for run in self.runs if not run.failed]

    def values(self, measure: str) -> FloatArray:
        """(n,) of `measure`, a property of the runs that have not failed."""
        return np.array([getattr(run, measure) for run in self.kept], dtype=np.float64)

    def axis_errors(self) -> FloatArray:
        """(n, 3) m, |declared - source| along x, y and z of the runs that have not failed."""
        return np.abs(np.array([run.offset for run in self.kept], dtype=np.float64).reshape(-1, 3))


def planned_cases(benchmark: str, episodes: int | None = None, first_seed: int | None = None) -> list[Case]:
    """What the shipped `benchmark` flies, with at most `episodes` seeds each."""
    return load_benchmark(benchmark).limited(episodes, first_seed).cases()


def fly_cases(cases: Sequence[Case], *, n_jobs: int | None = None, progress: bool | None = None) -> list[Flown]:
    """Fly `cases`, and average the true plumes in their maps' cells. Arguments as for `training.evaluate`."""
    flights = _spread(fly_case, cases, "case", n_jobs, progress)
    wanted = {
        _Episode.of(case.cell.scenario, landed): (case.cell.scenario, landed.record.seed, landed.maps.cells)
        for case, group in zip(cases, flights, strict=True)
        for landed in group
    }
    truths = dict(zip(wanted, _spread(_truth, list(wanted.values()), "true map", n_jobs, progress), strict=True))
    return [
        Flown(
            case,
            tuple(
                Run(landed, truths[_Episode.of(case.cell.scenario, landed)], _floor(case.cell.scenario))
                for landed in group
            ),
        )
        for case, group in zip(cases, flights, strict=True)
    ]


def fly_case(case: Case) -> list[Landed]:
    """All flights of `case`, side by side."""
    policy, scenario, seeds = case.cell.policy, case.cell.scenario, case.cell.seeds
    places: list[FloatArray] = []
    flight = fly(policy, scenario, seeds, watch=lambda world: places.append(world.motion["position"][:, 0].copy()))
    tracks = np.stack(places, axis=1)  # (n_envs, m, 3)
    landed = []
    for env in range(len(seeds)):
        record = EpisodeRecord.of(flight.world, env, policy.name)
        pilot = flight.team[env][max(record.winner, 0)]
        source = flight.world.source_position[env, 0].copy()
        landed.append(Landed(record, source, pilot.declaration(), maps_of(pilot), tracks[env]))
    return landed


class _Episode(NamedTuple):
    """What a true map depends on."""

    scenario: str
    seed: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    shape: tuple[int, int, int]

    @classmethod
    def of(cls, scenario: Scenario, landed: Landed) -> _Episode:
        cells = landed.maps.cells
        return cls(scenario.hash, landed.record.seed, tuple(cells.low), tuple(cells.high), cells.shape)


def _truth(episode: tuple[Scenario, int, Cells]) -> FloatArray:
    """(n,) averaged over the time budget of the flight: the air is the one that the flight met."""
    scenario, seed, cells = episode
    return true_mean_map(scenario, seed, cells, scenario.ending.time_limit)


def _floor(scenario: Scenario) -> float:
    """Below a detection nothing is gas."""
    return float(getattr(scenario.gas_sensor, "threshold", 0.0))


def _spread(
    work: Callable[[Item], Product], items: Sequence[Item], unit: str, n_jobs: int | None, progress: bool | None
) -> list[Product]:
    """`work` done on every item, over the processes."""
    jobs = min(check_jobs(n_jobs), len(items))
    show = sys.stderr.isatty() if progress is None else progress

    def products() -> Iterator[Product]:
        if jobs <= 1:
            yield from map(work, items)
            return
        with parallel_config(backend="loky", inner_max_num_threads=1):
            yield from Parallel(n_jobs=jobs, return_as="generator")(delayed(_in_worker)(work, item) for item in items)

    with tqdm(total=len(items), unit=unit, disable=not show, leave=False) as bar:
        done = []
        for product in products():
            done.append(product)
            bar.update()
        return done


def _in_worker(work: Callable[[Item], Product], item: Item) -> Product:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the parent ends its workers
    return work(item)
