"""The store: what is finished is never flown again, what changed is, and a cut-off line does no harm."""

from __future__ import annotations

from pathlib import Path

import pytest
from guesser import Guesser

from osl_env.errors import InputError
from osl_env.record import EpisodeRecord
from osl_env.scenario_files import load_scenario
from training import evaluate
from training import sweep as sweep_module
from training.store import Store, cell_key
from training.sweep import Cell, ExperimentStopped, run_cells

SCENARIO = "rate-60x60x30"


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The seeds that were really flown."""
    seeds: list[int] = []
    real = sweep_module.run_batch

    def counted(*arguments: object) -> list[EpisodeRecord]:
        seeds.extend(arguments[2])  # type: ignore[call-overload]
        return real(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(sweep_module, "run_batch", counted)
    return seeds


def test_finished_episodes_are_not_flown_again(tmp_path: Path, flown: list[int]) -> None:
    first = evaluate("guesser", SCENARIO, range(3), n_jobs=1, store=tmp_path)
    again = evaluate("guesser", SCENARIO, range(5), n_jobs=1, store=tmp_path)
    assert flown == [0, 1, 2, 3, 4]
    assert [a.to_dict() for a in again[:3]] == [a.to_dict() for a in first]


def test_other_parameters_scenario_or_name_are_other_keys() -> None:
    scenario = load_scenario(SCENARIO)
    keys = {
        cell_key(scenario, Guesser()),
        cell_key(scenario, Guesser(patience=3)),
        cell_key(load_scenario(SCENARIO, **{"team.n_uavs": 2}), Guesser()),
    }
    assert len(keys) == 3
    assert cell_key(scenario, Guesser(patience=12)) == cell_key(scenario, Guesser())


def test_a_cut_off_line_is_dropped_and_flown_again(tmp_path: Path, flown: list[int]) -> None:
    evaluate("guesser", SCENARIO, range(3), n_jobs=1, store=tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-40])
    flown.clear()
    again = evaluate("guesser", SCENARIO, range(3), n_jobs=1, store=tmp_path)
    assert flown == [2]
    assert [record.seed for record in again] == [0, 1, 2]
    assert path.read_bytes().count(b"\n") == 3


def test_a_foreign_file_is_named(tmp_path: Path) -> None:
    key = cell_key(load_scenario(SCENARIO), Guesser())
    (tmp_path / f"{key}.jsonl").write_text('{"seed": 0}\n')
    with pytest.raises(InputError, match=r"line 1 is not an episode record"):
        Store(tmp_path).finished(key)


def test_a_store_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"cannot be (read|written|made)"):
        evaluate("guesser", SCENARIO, [0], n_jobs=1, store=tmp_path / "file")


def test_ctrl_c_keeps_what_is_finished_and_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = sweep_module.run_batch

    def stops(policy: Guesser, scenario: object, seeds: tuple[int, ...]) -> list[EpisodeRecord]:
        if 4 in seeds:
            raise KeyboardInterrupt
        return real(policy, scenario, seeds)  # type: ignore[arg-type]

    monkeypatch.setattr(sweep_module, "run_batch", stops)
    cell = Cell(Guesser(), load_scenario(SCENARIO), tuple(range(6)))
    with pytest.raises(ExperimentStopped, match=r"4 of 6 episodes are finished and kept in .*; the same command"):
        run_cells([cell], n_jobs=1, store=Store(tmp_path), batch_size=2)
    monkeypatch.setattr(sweep_module, "run_batch", real)
    assert sorted(Store(tmp_path).finished(cell.key)) == [0, 1, 2, 3]
    assert len(run_cells([cell], n_jobs=1, store=Store(tmp_path))[0]) == 6


def test_cells_with_common_episodes_fly_them_once(flown: list[int]) -> None:
    scenario = load_scenario(SCENARIO)
    long, short = run_cells([Cell(Guesser(), scenario, (0, 1, 2)), Cell(Guesser(), scenario, (2, 1))], n_jobs=1)
    assert sorted(flown) == [0, 1, 2]
    assert [record.seed for record in short] == [2, 1]
    assert short[1] is long[1]
