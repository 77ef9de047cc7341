"""Benchmark files, tables and figures, and the reproduction of papers, on a policy that costs nothing."""

from __future__ import annotations

import math
from pathlib import Path

import guesser
import pytest
from rich.console import Console

from osl_env.errors import InputError
from training.benchmark import Benchmark, Result, benchmark_names, load_benchmark, run_benchmark
from training.comparison import grouped, wide
from training.figures import curves, energy_bars, save, side_by_side
from training.records import EpisodeRecords, write_table
from training.report import group_tables, overall_table, rules, sweep_tables
from training.reproduce.claims import Beats, Helps, Saturates
from training.reproduce.experiment import Experiment, reproduce
from training.reproduce.muc_osl import EXPERIMENTS

assert guesser  # registers the policy that the files below name

CONFIG = """
title: two guessers
seeds: {first: 5, count: 4}
scenarios:
  - rate-60x60x30
  - {scenario: rate-100x60x30, overrides: {team.n_uavs: 2, ending.success_radius: 60}, label: two UAVs}
policies:
  - guesser
  - {policy: guesser, parameters: {patience: 3}, label: impatient, episodes: 3}
"""


@pytest.fixture(scope="module")
def results() -> list[Result]:
    return run_benchmark(load_text(CONFIG), n_jobs=1)


def load_text(text: str) -> Benchmark:
    import yaml

    return Benchmark.model_validate(yaml.safe_load(text))


def test_cases_are_policies_times_scenarios_with_common_seeds(results: list[Result]) -> None:
    assert [(r.case.scenario, r.case.policy, r.case.cell.seeds) for r in results] == [
        ("rate-60x60x30", "guesser", (5, 6, 7, 8)),
        ("rate-60x60x30", "impatient", (5, 6, 7)),
        ("two UAVs", "guesser", (5, 6, 7, 8)),
        ("two UAVs", "impatient", (5, 6, 7)),
    ]
    assert results[2].records[0].n_uavs == 2


def test_limits_apply_to_every_case() -> None:
    cases = load_text(CONFIG).limited(episodes=2, first_seed=100).cases()
    assert {case.cell.seeds for case in cases} == {(100, 101)}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser]\nseed: 3\n", "unknown key 'seed'"),
        ("title: x\nscenarios: []\npolicies: [guesser]\n", "scenarios"),
        ("title: x\npolicies: [guesser]\n", "key 'scenarios' is missing"),
        ("title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser, guesser]\n", "'guesser' comes twice"),
        ("title: x\nscenarios: [rate-60x60x30]\npolicies: [nobody]\n", "unknown policy 'nobody'"),
        ("title: x\nscenarios: [nowhere]\npolicies: [guesser]\n", "unknown scenario 'nowhere'"),
        (
            "title: x\nscenarios: [rate-60x60x30]\npolicies: [{policy: guesser, parameters: {x: 1}}]\n",
            "unknown key 'x'",
        ),
        ("title: x\nseeds: {count: 0}\nscenarios: [rate-60x60x30]\npolicies: [guesser]\n", "seeds.count = 0"),
        (
            "title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser]\nsweep: {key: team.n_uavs, values: [0]}\n",
            "n_uavs",
        ),
        ("[1, 2]", "mapping"),
        ("title: [", "is not YAML"),
    ],
)
def test_a_bad_file_is_named_with_its_key(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=complaint) as caught:
        load_benchmark(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_comparison_is_with_the_best_on_common_seeds(results: list[Result]) -> None:
    for group in grouped(results):
        best = [row for row in group.rows if row.against_best is None]
        others = [row for row in group.rows if row.against_best is not None]
        assert len(best) == len(others) == 1
        assert others[0].against_best is not None
        assert others[0].against_best.pairs == 3
        assert others[0].against_best.difference.value >= 0.0 or others[0].label == "impatient"
    lines = wide(grouped(results))
    assert [line["best"] for line in lines].count(True) == 2
    assert {"success_rate_low", "energy_turning", "p_holm", "bytes_high"} <= set(lines[0])


def test_tables_fit_eighty_columns(results: list[Result]) -> None:
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    groups = grouped(results)
    console.print(group_tables(groups))
    console.print(sweep_tables(groups, None))
    console.print(overall_table(groups))
    console.print(rules(groups))
    text = console.export_text()
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text  # nothing was cut
    assert "impatient" in text
    assert "episodes: 4, but impatient 3" in text


def test_figures_are_written_whole(results: list[Result], tmp_path: Path) -> None:
    groups = grouped(results)
    for name, figure in {
        "dots": side_by_side(groups, "t"),
        "curves": curves(groups, "t", None),
        "bars": energy_bars(groups, "t"),
    }.items():
        save(figure, tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("suffix", [".csv", ".json", ".parquet"])
def test_tables_are_read_back_as_written(results: list[Result], tmp_path: Path, suffix: str) -> None:
    import pandas as pd

    frame = results[0].records.to_frame()
    path = tmp_path / f"episodes{suffix}"
    write_table(path, frame)
    read = {".csv": pd.read_csv, ".json": pd.read_json, ".parquet": pd.read_parquet}[suffix](path)
    assert read["mission_time"].to_numpy() == pytest.approx(frame["mission_time"].to_numpy())
    assert read["seed"].tolist() == [5, 6, 7, 8]
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_an_empty_record_list_has_a_frame() -> None:
    assert len(EpisodeRecords().to_frame()) == 0


def test_shipped_benchmarks_load() -> None:
    for name in benchmark_names():
        assert load_benchmark(name).cases()


SWEEP = """
title: more patience
seeds: {count: 12}
scenarios: [{scenario: rate-60x60x30, overrides: {ending.success_radius: 50}}]
policies: [guesser, {policy: guesser, label: wanderer, parameters: {spread: 30}}]
sweep: {of: policy, key: patience, values: [1, 3, 9], label: patience}
"""


def test_claims_follow_the_figures(tmp_path: Path) -> None:
    path = tmp_path / "sweep.yaml"
    path.write_text(SWEEP)
    everyone = ("guesser", "wanderer")
    experiment = Experiment(
        name="patience",
        benchmark=str(path),
        summary="",
        claims=(
            Helps("fewer decisions, fewer hovers", everyone, 9, 1, "n_hovers"),
            Helps("more decisions, fewer hovers", everyone, 1, 9, "n_hovers"),
            Helps("the same", everyone, 3, 3, "n_hovers"),
            Beats("nobody beats himself", "guesser", "guesser", "success_rate"),
            Saturates("hovers grow ever faster", everyone, 9, 3, 1, "n_hovers"),
        ),
        remarks="None.",
    )
    outcome = reproduce(experiment, n_jobs=1)
    verdicts = [finding.verdict for finding in outcome.findings]
    assert verdicts == ["holds", "contradicted", "open", "open", "holds"]
    outcome.write(tmp_path / "out")
    assert {entry.name for entry in (tmp_path / "out").iterdir()} == {
        "table.csv",
        "episodes.csv",
        "notes.md",
        "figure.png",
    }
    notes = (tmp_path / "out" / "notes.md").read_text()
    assert "| fewer decisions, fewer hovers | hovering points, 1 - 9: -" in notes
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(outcome.tables())
    console.print(outcome.verdicts())
    assert max(map(len, console.export_text().splitlines())) <= 80


def test_every_claim_of_a_paper_can_be_checked_by_its_benchmark() -> None:
    """The labels and values that the claims name are rows of the benchmark."""
    for experiment in EXPERIMENTS.values():
        cases = load_benchmark(experiment.benchmark).cases()
        policies = {case.policy for case in cases}
        places = {case.value for case in cases} | {case.scenario for case in cases}
        for claim in experiment.claims:
            if isinstance(claim, Beats):
                assert {claim.better, claim.worse} <= policies
            elif isinstance(claim, Helps):
                assert set(claim.policies) <= policies
                assert {claim.before, claim.after} <= places
            elif isinstance(claim, Saturates):
                assert set(claim.policies) <= policies
                assert {claim.first, claim.middle, claim.last} <= places
    assert math.inf in {case.value for case in load_benchmark("muc_osl_radius").cases()}
