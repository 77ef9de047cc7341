"""Benchmark files, tables and figures, and the reproduction of papers, on a policy that costs nothing."""

from __future__ import annotations

import math
from pathlib import Path

import guesser
import numpy as np
import pytest
from rich.console import Console

from baselines import policy_names
from baselines.policy import SHIPPED_CHECKPOINTS
from osl_env.errors import InputError
from training.benchmark import Benchmark, Result, benchmark_names, load_benchmark, run_benchmark
from training.comparison import comparisons, grouped, wide
from training.figures import curves, energy_bars, profile_lines, save, side_by_side
from training.overall import over_all, profiles
from training.records import EpisodeRecords, write_table
from training.report import group_tables, overall_table, rules, sweep_tables
from training.reproduce.claims import Beats, Helps, Saturates
from training.reproduce.experiment import Experiment, reproduce
from training.reproduce.muc_osl import EXPERIMENTS
from training.statistics import compare_paired, holm

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
        (
            "title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser]\ncompare: nobody\n",
            "compare = 'nobody': must be one of the policies guesser",
        ),
        (
            "title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser]\ncompare: [guesser, guesser]\n",
            "each once",
        ),
        (
            "title: x\nscenarios: [{scenario: rate-60x60x30, swept: team.n_uavs}]\npolicies: [guesser]\n",
            "scenarios.0.swept = 'team.n_uavs': needs a sweep of scenario",
        ),
        (
            "title: x\nscenarios: [rate-60x60x30]\npolicies: [guesser]\nsweep: {values: [1]}\n",
            "sweep.key = '': must name what is varied, unless every scenario has a `swept` key",
        ),
        (
            "title: x\nscenarios: [{scenario: rate-60x60x30, swept: team.n_uavs}]\npolicies: [guesser]\n"
            "sweep: {values: [1]}\n",
            "sweep.label = '': must say what is varied",
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
    groups = grouped(results)
    for group in groups:
        (best,) = (row for row in group.rows if row.best)
        (other,) = (row for row in group.rows if not row.best)
        assert group.picked
        assert group.references == (best.label,)
        assert best.against == {}
        assert other.against[best.label].search_time.pairs == 3
        assert other.against[best.label].search_time.difference.value >= 0.0 or other.label == "impatient"
    lines = wide(groups)
    assert [line["best"] for line in lines].count(True) == 2
    assert {"success_rate_low", "energy_turning", "bytes_high"} <= set(lines[0])
    assert [line["reference"] for line in comparisons(groups)] == [group.references[0] for group in groups]


def test_a_named_reference_is_compared_with_all_others(results: list[Result]) -> None:
    for group in grouped(results, ["impatient"]):
        guesser_row, impatient = group.rows
        assert not group.picked
        assert impatient.against == {}
        times = [row.result.records.values("capped_search_time")[:3] for row in (guesser_row, impatient)]
        difference = guesser_row.against["impatient"].search_time.difference
        assert difference.value == pytest.approx((times[0] - times[1]).mean())


def test_two_references_are_compared_with_each_other_once(results: list[Result]) -> None:
    """Holm's correction over one comparison changes nothing; counted twice, it would double p."""
    alone = grouped(results, ["impatient"])
    both = grouped(results, ["impatient", "guesser"])
    for one, two in zip(alone, both, strict=True):
        (mine,) = (row.against["impatient"] for row in one.rows if row.against)
        forth, back = two.rows[0].against["impatient"], two.rows[1].against["guesser"]
        assert forth == mine
        assert back.search_time.p_value == mine.search_time.p_value
        assert back.search_time.difference.value == -mine.search_time.difference.value
        assert back.search_time.difference.low == -mine.search_time.difference.high
        assert back.reference_faster.value == pytest.approx(1.0 - mine.reference_faster.value)


def test_holm_counts_all_comparisons_of_a_group() -> None:
    text = """
title: three guessers
seeds: {count: 8}
scenarios: [{scenario: rate-60x60x30, overrides: {ending.success_radius: 50}}]
policies:
  - guesser
  - {policy: guesser, parameters: {patience: 3}, label: a}
  - {policy: guesser, parameters: {patience: 2}, label: b}
compare: [guesser, a]
"""
    benchmark = load_text(text)
    results = run_benchmark(benchmark, n_jobs=1)
    (group,) = grouped(results, benchmark.compare)
    times = {row.label: row.result.records.values("capped_search_time") for row in group.rows}
    pairs = [("a", "guesser"), ("b", "guesser"), ("b", "a")]
    expected = holm([compare_paired(times[one], times[other]).p_value for one, other in pairs])
    found = {row.label: row.against for row in group.rows}
    assert [found[one][other].search_time.p_value for one, other in pairs] == pytest.approx(expected)


def test_over_all_takes_policies_with_equal_numbers_of_episodes(results: list[Result]) -> None:
    overall = over_all(grouped(results, ["guesser"]))
    assert {one.label: one.episodes for one in overall} == {"guesser": 4, "impatient": 3}
    (impatient,) = (one for one in overall if one.label == "impatient")
    assert set(impatient.reference_faster) == {"guesser"}
    times = np.stack([r.records.values("capped_search_time") for r in results if r.case.policy == "impatient"], axis=1)
    assert impatient.search_time["mean"].value == pytest.approx(times.mean())
    rates = [r.records.values("success_rate").mean() for r in results if r.case.policy == "impatient"]
    assert impatient.success_rate.value == pytest.approx(np.mean(rates))
    assert over_all(grouped(results[:3])) != []
    assert [one.label for one in over_all(grouped(results[:3]))] == ["guesser"]  # the other flew in one scenario only


def test_profiles_end_at_the_success_rate(results: list[Result]) -> None:
    groups = grouped(results)
    found = profiles(groups)
    rates = {one.label: one.success_rate.value for one in over_all(groups)}
    assert {label: profile.share[-1] for label, profile in found.of.items()} == pytest.approx(rates)


def test_tables_fit_eighty_columns(results: list[Result]) -> None:
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    groups = grouped(results)
    console.print(group_tables(grouped(results, ["impatient", "guesser"])))
    console.print(rules(grouped(results, ["impatient", "guesser"])))
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
        "profile": profile_lines(profiles(groups)),
        "formula": side_by_side(groups, "$\\broken{$"),
    }.items():
        save(figure, tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert len(list(tmp_path.iterdir())) == 5


KEYS = """
title: what fails
seeds: {count: 3}
scenarios:
  - {scenario: rate-60x60x30, overrides: {uav_faults.lost_uav.time: 20}, swept: uav_faults.lost_uav.number, label: UAVs}
  - {scenario: rate-60x60x30, swept: uav_faults.lost_radio.number, label: radios}
policies: [guesser]
sweep: {values: [0, 3], label: that fail}
"""


def test_each_scenario_may_sweep_a_key_of_its_own() -> None:
    cases = load_text(KEYS).cases()
    assert [(case.scenario, case.value) for case in cases] == [("UAVs", 0), ("radios", 0), ("UAVs", 3), ("radios", 3)]
    faults = [case.cell.scenario.uav_faults.model_dump(exclude_none=True) for case in cases]
    assert faults[2:] == [{"lost_uav": {"number": 3, "time": 20.0}}, {"lost_radio": {"number": 3}}]
    keys = [case.cell.key for case in cases]
    assert keys[0] == keys[1]  # nothing fails: flown once
    assert len(set(keys)) == 3


def test_a_sweep_over_several_scenarios_is_a_column_each() -> None:
    benchmark = load_text(KEYS)
    figure = curves(grouped(run_benchmark(benchmark, n_jobs=1)), "t", benchmark.sweep)
    axes = figure.get_axes()
    assert [axis.get_title() for axis in axes] == ["UAVs", "radios", "", ""]
    for axis in axes:
        assert [len(line.get_xdata()) for line in axis.get_lines() if line.get_label() == "guesser"] in ([], [2])
        assert [tick.get_text() for tick in axis.get_xticklabels()] == ["0", "3"]
    assert axes[0].get_ylabel() == "success rate, %"
    assert axes[2].get_xlabel() == "that fail"
    for axis in axes[2:]:
        lines = axis.get_lines()
        assert axis.get_ylim()[1] > max(max(line.get_ydata()) for line in lines if len(line.get_ydata()))


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


def test_the_leaderboard_flies_everyone_on_seeds_that_nobody_trained_on() -> None:
    leaderboard = load_benchmark("leaderboard")
    areas = ("rate-60x60x30", "rate-100x60x30", "rate-100x100x50", "rate-100x200x50")
    assert {entry.scenario for entry in leaderboard.scenarios} == {*areas, *(f"{area}-random" for area in areas)}
    assert leaderboard.seeds.first >= 100_000
    episodes = {entry.policy: entry.episodes or leaderboard.seeds.count for entry in leaderboard.policies}
    assert min(episodes.values()) >= 200
    shipped = set(SHIPPED_CHECKPOINTS) & set(policy_names())
    assert shipped <= set(episodes)
    assert all(episodes[name] >= 1000 for name in shipped)
    assert {entry.policy for entry in load_benchmark("muc_osl_random").policies} <= set(episodes)


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
