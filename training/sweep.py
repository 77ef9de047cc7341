"""Runs experiments on all cores: `evaluate` one cell (policy x scenario x seeds), `run_cells` many.

Cells are cut into batches of worlds, and batches are spread over processes; what two cells have in common is run once.
Finished batches go to the store at once, so Ctrl-C loses only what is in the air. Number of processes, batch size and
order change nothing but the wall time.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from joblib import Parallel, delayed, parallel_config
from tqdm import tqdm

from baselines import Policy, make_policy
from osl_env.errors import InputError
from osl_env.record import EpisodeRecord
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.streams import check_seed
from training.flight import fly, run_batch
from training.records import EpisodeRecords
from training.store import Store, cell_key

BATCH_SIZE = 16  # worlds a batch: enough to share the cost of a step, few enough to keep all cores busy to the end


@dataclass(frozen=True)
class Cell:
    """One policy in one scenario, over `seeds`."""

    policy: Policy
    scenario: Scenario
    seeds: tuple[int, ...]

    @property
    def key(self) -> str:
        """What its episodes depend on but the seed; see `training.store.cell_key`."""
        return cell_key(self.scenario, self.policy)


class _Batch(NamedTuple):
    key: str
    policy: Policy
    scenario: Scenario
    seeds: tuple[int, ...]


class ExperimentStopped(KeyboardInterrupt):
    """Ctrl-C during an experiment; the message says what is kept and how to go on."""


class _Plan:
    """Which episodes are wanted, finished and missing, by cell key; a key that several cells share counts once."""

    def __init__(self, cells: Sequence[Cell], store: Store | None) -> None:
        self.cells = cells
        self.store = store
        self.keys = [cell.key for cell in cells]
        self.one_of = dict(zip(self.keys, cells, strict=True))
        self.wanted: dict[str, dict[int, None]] = {key: {} for key in self.one_of}  # an ordered set of seeds
        for key, cell in zip(self.keys, cells, strict=True):
            self.wanted[key] |= dict.fromkeys(cell.seeds)
        self.finished = {key: store.finished(key) if store else {} for key in self.one_of}

    @property
    def total(self) -> int:
        return sum(map(len, self.wanted.values()))

    @property
    def done(self) -> int:
        return sum(len(self.wanted[key].keys() & self.finished[key].keys()) for key in self.wanted)

    def batches(self, batch_size: int, jobs: int) -> list[_Batch]:
        """What is missing, in batches of at most `batch_size`, and at least two for each process."""
        batches = []
        for key, cell in self.one_of.items():
            missing = [seed for seed in self.wanted[key] if seed not in self.finished[key]]
            size = min(batch_size, max(1, -(-len(missing) // (2 * jobs))))
            batches += [
                _Batch(key, cell.policy, cell.scenario, tuple(missing[start : start + size]))
                for start in range(0, len(missing), size)
            ]
        return batches

    def keep(self, batch: _Batch, records: list[EpisodeRecord]) -> None:
        if self.store:
            self.store.add(batch.key, records)
        self.finished[batch.key] |= {record.seed: record for record in records}

    def how_to_go_on(self) -> str:
        if self.done == 0:
            return "stopped before any of its episodes was finished"
        if self.store:
            kept = f"kept in {self.store.folder}; the same command goes on from there"
        else:
            kept = "lost: there is no store"
        return f"stopped: {self.done} of {self.total} episodes are finished and {kept}"


def evaluate(
    policy: Policy | str,
    scenario: Scenario | str | Path,
    seeds: Iterable[int],
    *,
    n_jobs: int | None = None,
    store: Store | str | Path | None = None,
    progress: bool | None = None,
    batch_size: int = BATCH_SIZE,
) -> EpisodeRecords:
    """Fly `policy` through one episode of `scenario` for each seed; the records come in the order of `seeds`.

    `n_jobs`: processes, all cores by default. `store`: a folder that keeps finished episodes, and from which those
    already there are taken. `progress`: a bar on stderr; by default if that is a terminal.
    Raises InputError for an unknown name, a bad seed, or a policy that does not fit the scenario.
    """
    flown = make_policy(policy) if isinstance(policy, str) else policy
    cell = Cell(flown, load_scenario(scenario), tuple(check_seed(seed) for seed in seeds))
    kept = store if isinstance(store, Store) or store is None else Store(store)
    return run_cells([cell], n_jobs=n_jobs, store=kept, progress=progress, batch_size=batch_size)[0]


def run_cells(
    cells: Sequence[Cell],
    *,
    n_jobs: int | None = None,
    store: Store | None = None,
    progress: bool | None = None,
    batch_size: int = BATCH_SIZE,
) -> list[EpisodeRecords]:
    """The records of every cell, in the order of `cells` and of their seeds.

    Arguments as for `training.evaluate`. Raises InputError for bad ones, ExperimentStopped on Ctrl-C.
    """
    jobs = check_jobs(n_jobs)
    if batch_size < 1:
        raise InputError(f"batch_size = {batch_size}: must be at least 1")
    if store:
        store.check()
    plan = _Plan(cells, store)
    show = sys.stderr.isatty() if progress is None else progress
    with tqdm(total=plan.total, initial=plan.done, unit="episode", disable=not show, leave=False) as bar:
        try:
            batches = _run_batches(plan.batches(batch_size, jobs), jobs)
            with _one_interrupt(), contextlib.closing(batches):
                for batch, records in batches:
                    plan.keep(batch, records)
                    bar.update(len(records))
        except KeyboardInterrupt:
            raise ExperimentStopped(plan.how_to_go_on()) from None
    return [
        EpisodeRecords(plan.finished[key][seed] for seed in cell.seeds)
        for key, cell in zip(plan.keys, cells, strict=True)
    ]


def finished_episodes(cells: Sequence[Cell], store: Store | None) -> tuple[int, int]:
    """How many of the episodes of `cells` are in `store`, and how many there are: what cells share counts once."""
    plan = _Plan(cells, store)
    return plan.done, plan.total


@contextlib.contextmanager
def _one_interrupt() -> Iterator[None]:
    """Let the first Ctrl-C through and ignore those that follow it, which would break off the ending of the workers."""
    if threading.current_thread() is not threading.main_thread():  # where Python delivers no signals
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        warnings.simplefilter("ignore")  # joblib's, that tasks have been cancelled
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, stop)
    try:
        with warnings.catch_warnings():
            yield
    finally:
        signal.signal(signal.SIGINT, before)


def check_jobs(n_jobs: int | None) -> int:
    """The number of processes that `n_jobs` means: all cores for None. Raises InputError below 1."""
    if n_jobs is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if n_jobs < 1:
        raise InputError(f"n_jobs = {n_jobs}: must be at least 1")
    return n_jobs


def _run_batches(batches: list[_Batch], jobs: int) -> Generator[tuple[_Batch, list[EpisodeRecord]], None, None]:
    """Yield each batch with its records as it is done; in this process where there is nothing to spread."""
    if jobs == 1 or len(batches) < 2:
        for batch in batches:
            yield batch, _fly_batch(batch)
        return
    with parallel_config(backend="loky", inner_max_num_threads=1):
        pool = Parallel(n_jobs=min(jobs, len(batches)), return_as="generator_unordered", batch_size=1)
        for number, records in pool(delayed(_fly_in_worker)(number, batch) for number, batch in enumerate(batches)):
            yield batches[number], records


def _fly_in_worker(number: int, batch: _Batch) -> tuple[int, list[EpisodeRecord]]:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the parent ends its workers
    return number, _fly_batch(batch)


def _fly_batch(batch: _Batch) -> list[EpisodeRecord]:
    _rehearse(batch)
    return run_batch(batch.policy, batch.scenario, batch.seeds)


_rehearsed: set[str] = set()


def _rehearse(batch: _Batch) -> None:
    """Load the compiled kernels before the clock of the decisions runs: once a process and cell."""
    if batch.key not in _rehearsed:
        _rehearsed.add(batch.key)
        fly(batch.policy, batch.scenario, batch.seeds[:1], max_decisions=3)
