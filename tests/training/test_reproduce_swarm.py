"""`osl reproduce swarm`: what is planned, pooled intervals, claims in all directions, forces, pictures, a flight."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console, RenderableType

from baselines import make_policy
from baselines.swarm.law import LawParameters
from osl_env.record import EpisodeRecord
from osl_env.scenario_files import load_scenario
from osl_env.world import World
from training.benchmark import Case, Result
from training.records import EpisodeRecords
from training.reproduce.papers import PAPERS
from training.reproduce.report import verdicts
from training.reproduce.swarm import EXPERIMENTS, claims, tables
from training.reproduce.swarm import force_checks as checks
from training.reproduce.swarm.averages import SUCCESS, Pool, difference, ratio
from training.reproduce.swarm.experiment import SwarmExperiment, SwarmReport
from training.reproduce.swarm.film import film
from training.reproduce.swarm.film_pictures import pages, snapshots
from training.reproduce.swarm.forces import EXPERIMENT as FORCES
from training.reproduce.swarm.runs import Flown, Setting, fly_settings, planned_cases
from training.reproduce.swarm.search_time import CONCENTRATION, LARGE, SMALL
from training.statistics import stratified_mean
from training.sweep import Cell

FIRST_SEED = 100_000
LIMIT = 600.0  # s
FULL = claims.FULL
SHARED = Setting(FULL, 5, 0.02, 15)  # by the ablations


@pytest.fixture(scope="module")
def template() -> EpisodeRecord:
    world = World(load_scenario("arena-4x6-0", **{"plume.development": 0.1, "team.n_uavs": 1}))
    world.reset([FIRST_SEED])
    return EpisodeRecord.of(world, 0, "swarm")


@pytest.fixture(scope="module")
def small() -> dict[Setting, list[Case]]:
    """What `small` flies: read once, for a hundred scenarios take their time."""
    return planned_cases(SMALL.benchmarks)


@pytest.fixture(scope="module")
def large() -> dict[Setting, list[Case]]:
    """What `large` flies."""
    return planned_cases(LARGE.benchmarks)


def flown(
    template: EpisodeRecord,
    layouts: Sequence[Sequence[float]],
    policy: str = FULL,
    n_robots: int = 15,
    obstacles: int = 5,
    emission: float = 0.02,
) -> Flown:
    """Runs with search times by layout; a time of the limit is a failed run."""
    scenario, stand_in = load_scenario("arena-4x6-0"), make_policy("surge-cast")
    results = []
    for k, times in enumerate(layouts):
        records = EpisodeRecords(
            replace(template, seed=FIRST_SEED + j, search_time=time, success=time < LIMIT, n_uavs=n_robots)
            for j, time in enumerate(times)
        )
        cell = Cell(stand_in, scenario.model_copy(update={"name": f"layout {k}"}), tuple(r.seed for r in records))
        results.append(Result(Case(f"layout {k}", policy, float(n_robots), cell), records))
    return Flown(Setting(policy, obstacles, emission, n_robots), tuple(results))


def printed(content: RenderableType) -> str:
    """What a terminal of 80 columns shows."""
    console = Console(width=80, file=io.StringIO(), record=True)
    console.print(content)
    return console.export_text()


# --- what is flown


def test_small_pools_three_layouts_and_thirty_runs_a_setting(small: dict[Setting, list[Case]]) -> None:
    full = [setting for setting in small if setting.policy == FULL]
    assert len(full) == 3 * 3 * 4
    assert {(one.obstacles, one.emission, one.n_robots) for one in full} == {
        (obstacles, emission, n) for obstacles in (0, 5, 10) for emission in (0.01, 0.02, 0.05) for n in (5, 15, 20, 30)
    }
    for setting, cases in small.items():
        assert sum(len(case.cell.seeds) for case in cases) == 30
        assert len({case.cell.scenario.wind.field for case in cases}) == (3 if setting.obstacles else 1)  # type: ignore[union-attr]
        assert all(case.cell.scenario.wind.random_start for case in cases)  # type: ignore[union-attr]
        assert {case.cell.seeds[0] for case in cases} == {FIRST_SEED}


def test_ablations_differ_from_the_full_law_in_what_they_are_called_after(
    small: dict[Setting, list[Case]], large: dict[Setting, list[Case]]
) -> None:
    base = make_policy("swarm").model_dump()
    changed = {}
    for setting, cases in (small | large).items():
        policy = cases[0].cell.policy.model_dump()
        changed[setting.policy] = {key: value for key, value in policy.items() if value != base[key]}
    without_cohesion = {"repulsion_gain": 0.0, "attraction_gain": 0.0}
    assert changed == {
        FULL: {},
        "printed sign": {"sign": "printed"},
        "filter of 0.1 s": {"filter_time": 0.1},
        "upwind alone": {"gradient_gain": 0.0, **without_cohesion},
        "without cohesion": without_cohesion,
    }
    labels = {claim.policy for one in (SMALL, LARGE) for claim in one.claims if hasattr(claim, "policy")}
    assert labels | {FULL} == set(changed)


@pytest.mark.parametrize("experiment", [SMALL, LARGE, CONCENTRATION], ids=lambda one: one.name)
def test_claims_are_about_policies_that_are_flown(experiment: SwarmExperiment) -> None:
    flown = {setting.policy for setting in planned_cases(experiment.benchmarks, 1, 7)}
    named = {getattr(claim, key) for claim in experiment.claims for key in ("policy", "than") if hasattr(claim, key)}
    assert named <= flown
    assert FULL in flown


@pytest.mark.parametrize(("episodes", "counts"), [(7, [3, 2, 2]), (3, [1, 1, 1]), (2, [1, 1])])
def test_few_runs_are_spread_over_the_layouts(episodes: int, counts: list[int]) -> None:
    cases = planned_cases(("swarm_ablation",), episodes, 7)[SHARED]
    assert [len(case.cell.seeds) for case in cases] == counts
    assert all(case.cell.seeds[0] == 7 for case in cases)


def test_a_run_that_two_benchmarks_share_is_flown_once(small: dict[Setting, list[Case]]) -> None:
    alone = planned_cases(("swarm_ablation",))[SHARED]
    assert [case.cell.key for case in small[SHARED]] == [case.cell.key for case in alone]


def test_the_large_arena_has_three_laws_and_four_teams(large: dict[Setting, list[Case]]) -> None:
    assert len(large) == 12
    assert {setting.n_robots for setting in large} == {10, 20, 40, 60}
    assert all(len(cases) == 1 and len(cases[0].cell.seeds) == 30 for cases in large.values())


# --- averages


def test_layouts_weigh_the_same_and_failures_count_as_the_limit(template: EpisodeRecord) -> None:
    one = flown(template, [[100.0, 200.0, 300.0, 200.0], [LIMIT, 400.0]])
    pool = Pool([one])
    assert pool.mean([one.setting]).value == pytest.approx((200.0 + 500.0) / 2)
    assert (one.n_successes, one.success.value) == (5, pytest.approx(5 / 6))
    assert one.median == 250.0
    assert pool.mean([one.setting], SUCCESS).value == pytest.approx((1.0 + 0.5) / 2)


def test_the_interval_is_that_of_resampling_within_each_layout(template: EpisodeRecord) -> None:
    """Both bootstraps draw 9999 times: their bounds differ by some 2 % of the standard error, 10 s."""
    rng = np.random.default_rng(0)
    layouts = [rng.uniform(50.0, 250.0, 10), rng.uniform(300.0, 500.0, 10), rng.uniform(100.0, 200.0, 10)]
    one = flown(template, layouts)
    ours, reference = Pool([one]).mean([one.setting]).estimate, stratified_mean(layouts)
    assert ours.value == pytest.approx(reference.value)
    assert [ours.low, ours.high] == pytest.approx([reference.low, reference.high], abs=1.5)
    # the layouts' means differ by hundreds of seconds, which is no error of theirs
    assert ours.high - ours.low < 60.0


def test_common_worlds_cancel_in_ratios_and_differences(template: EpisodeRecord) -> None:
    times = np.random.default_rng(1).uniform(50.0, 300.0, 10)
    few, many = flown(template, [times * 1.5], n_robots=5), flown(template, [times], n_robots=15)
    pool = Pool([few, many])
    gain = ratio(pool.mean([few.setting]), pool.mean([many.setting]))
    assert list(gain) == pytest.approx([1.5] * 3)
    nothing = difference(pool.mean([few.setting], SUCCESS), pool.mean([many.setting], SUCCESS))
    assert list(nothing) == [0.0, 0.0, 0.0]


def test_a_single_run_has_no_interval_and_nothing_no_mean(template: EpisodeRecord) -> None:
    one = flown(template, [[100.0], [200.0]])
    pool = Pool([one])
    assert pool.mean([one.setting]).value == 150.0
    assert np.isnan(pool.mean([one.setting]).estimate[1:]).all()
    assert np.isnan(pool.mean([]).estimate).all()


def test_times_where_both_succeed_leave_the_other_worlds_out(template: EpisodeRecord) -> None:
    full = flown(template, [[100.0, 100.0, LIMIT, 100.0]])
    other = flown(template, [[50.0, LIMIT, 10.0, 50.0]], "upwind alone")
    pool = Pool([full, other])
    assert ratio(*pool.where_both_succeed([other.setting], [full.setting])).value == pytest.approx(0.5)
    never = flown(template, [[LIMIT] * 4], "printed sign")
    pool = Pool([full, never])
    assert np.isnan(ratio(*pool.where_both_succeed([never.setting], [full.setting]))).all()


# --- claims


def spread(mean: float) -> list[list[float]]:
    """Ten runs in each of two layouts, half above the mean and half below."""
    return [[mean * (0.9 if j % 2 else 1.1) for j in range(10)] for _ in range(2)]


def shuffled(mean: float) -> list[list[float]]:
    """As `spread`, the other half above."""
    return [list(reversed(times)) for times in spread(mean)]


@pytest.mark.parametrize(
    ("few", "many", "verdict"), [(300, 200, "holds"), (200, 300, "contradicted"), (200, 203, "open")]
)
def test_bigger_is_faster(template: EpisodeRecord, few: float, many: float, verdict: str) -> None:
    pool = Pool([flown(template, spread(few), n_robots=5), flown(template, shuffled(many), n_robots=15)])
    finding = claims.BiggerIsFaster(5, 15).check(pool)
    assert finding.verdict == verdict
    assert f"{few / many:.2f} [" in finding.ours


@pytest.mark.parametrize(
    ("hard", "easy", "verdict"), [(2.0, 1.2, "holds"), (1.1, 2.0, "contradicted"), (1.5, 1.5, "open")]
)
def test_the_gain_with_many_obstacles_and_a_weak_source(
    template: EpisodeRecord, hard: float, easy: float, verdict: str
) -> None:
    settings = []
    for obstacles, emission, gain in ((10, 0.01, hard), (0, 0.05, easy), (5, 0.02, 9.0)):
        settings.append(flown(template, spread(50.0 * gain), FULL, 5, obstacles, emission))
        settings.append(flown(template, shuffled(50.0), FULL, 30, obstacles, emission))
    finding = claims.GainsMost(5, 30).check(Pool(settings))
    assert finding.verdict == verdict
    assert "(10 obstacles, 0.01 g/s)" in finding.ours
    assert "(0 obstacles, 0.05 g/s)" in finding.ours


@pytest.mark.parametrize(("failed", "verdict"), [(0, "holds"), (10, "contradicted"), (2, "open")])
def test_copes_with_obstacles(template: EpisodeRecord, failed: int, verdict: str) -> None:
    runs = [[LIMIT] * failed + [100.0] * (50 - failed)]
    easy = flown(template, [[LIMIT] * 50], obstacles=0)  # not among obstacles: does not count
    assert claims.CopesWithObstacles().check(Pool([flown(template, runs), easy])).verdict == verdict


@pytest.mark.parametrize(("successes", "verdict"), [(0, "holds"), (20, "contradicted"), (6, "open")])
def test_a_reading_fails(template: EpisodeRecord, successes: int, verdict: str) -> None:
    other = flown(template, [[100.0] * successes + [LIMIT] * (30 - successes)], "printed sign")
    finding = claims.Fails("printed sign", "it fails", 0.2).check(Pool([flown(template, [[100.0] * 30]), other]))
    assert finding.verdict == verdict
    assert "swarm: 100 [89, 100] % of 30" in finding.ours


@pytest.mark.parametrize(("time", "verdict"), [(250.0, "holds"), (150.0, "contradicted"), (202.0, "open")])
def test_at_least_twice_as_long(template: EpisodeRecord, time: float, verdict: str) -> None:
    pool = Pool([flown(template, spread(100.0)), flown(template, shuffled(time), "without cohesion")])
    assert claims.SlowerThanFull("without cohesion", "twice", 2.0).check(pool).verdict == verdict


@pytest.mark.parametrize(("failed", "says"), [(15, "7.00"), (0, "1.00")])
def test_time_for_each_success_is_not_bounded_by_the_limit(template: EpisodeRecord, failed: int, says: str) -> None:
    """Half of the runs fail at 600 s, the others take 100 s: 350 s a run, 700 s a success, seven times 100 s."""
    other = flown(template, [[100.0] * (30 - failed) + [LIMIT] * failed], "without cohesion")
    pool = Pool([flown(template, [[100.0] * 30]), other])
    finding = claims.SlowerForEachSuccess("without cohesion", "twice", 2.0).check(pool)
    assert says in finding.ours
    assert finding.verdict == ("holds" if failed else "contradicted")


@pytest.mark.parametrize(("failed", "verdict"), [(10, "holds"), (0, "open")])
def test_loses_runs(template: EpisodeRecord, failed: int, verdict: str) -> None:
    upwind = flown(template, [[LIMIT] * failed + [60.0] * (30 - failed)], "upwind alone")
    pool = Pool([flown(template, [[100.0] * 30]), upwind])
    assert claims.LosesRuns("upwind alone", "it loses").check(pool).verdict == verdict
    assert claims.FasterWhenItSucceeds("upwind alone", "fast").check(pool).verdict == "holds"
    saved = Pool([flown(template, [[LIMIT] * 10 + [30.0] * 20]), flown(template, [[60.0] * 30], "upwind alone")])
    assert claims.LosesRuns("upwind alone", "it loses").check(saved).verdict == "contradicted"
    assert claims.FasterWhenItSucceeds("upwind alone", "fast").check(saved).verdict == "contradicted"


def test_one_failure_contradicts_always(template: EpisodeRecord) -> None:
    good, bad = ([[100.0] * 20], [[100.0] * 19 + [LIMIT]])
    assert claims.AlwaysSucceeds().check(Pool([flown(template, good)])).verdict == "holds"
    assert claims.AlwaysSucceeds().check(Pool([flown(template, bad)])).verdict == "contradicted"


# --- tables, notes and figures


def everything(template: EpisodeRecord, experiment: SwarmExperiment, planned: dict[Setting, list[Case]]) -> SwarmReport:
    """A report on made-up runs in every setting that the experiment flies."""
    rng = np.random.default_rng(2)
    runs = []
    for setting, cases in planned.items():
        results = []
        for case in cases:
            times = [min(float(time), LIMIT) for time in rng.uniform(50.0, 1.1 * LIMIT, len(case.cell.seeds))]
            records = EpisodeRecords(
                replace(template, seed=seed, search_time=time, success=time < LIMIT)
                for seed, time in zip(case.cell.seeds, times, strict=True)
            )
            results.append(Result(case, records))
        runs.append(Flown(setting, tuple(results)))
    pool = Pool(runs)
    return SwarmReport(experiment, runs, pool, [claim.check(pool) for claim in experiment.claims])


@pytest.mark.parametrize("experiment", [SMALL, LARGE], ids=lambda one: one.name)
def test_reports_fit_the_terminal_and_are_written_whole(
    template: EpisodeRecord, experiment: SwarmExperiment, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    report = everything(template, experiment, request.getfixturevalue(experiment.name))
    shown = printed(report.tables()) + printed(verdicts(report.findings))
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    rows = report.rows()
    assert len(rows) == len(report.flown) == (39 if experiment is SMALL else 12)
    listed = [setting for _, settings in report._titled for setting in settings]
    assert set(listed) == set(report.pool.flown)
    assert set(report.write(tmp_path)) == {path.name for path in tmp_path.iterdir()}
    notes = (tmp_path / "notes.md").read_text()
    assert all(finding.ours in notes for finding in report.findings)
    assert "not at hand as numbers" in notes


def test_tables_say_what_differs(template: EpisodeRecord) -> None:
    runs = [flown(template, spread(100.0), n_robots=n, emission=emission) for emission in (0.01, 0.05) for n in (5, 15)]
    header, *lines = tables.lined(Pool(runs), [one.setting for one in runs])
    assert header[:2] == ["emission\ng/s", "N"]
    assert [line[:2] for line in lines] == [["0.01", "5"], ["0.01", "15"], ["0.05", "5"], ["0.05", "15"]]
    assert lines[0][2:5] == ["100 [84, 100]", "20", "100.0"]


# --- forces


def test_the_forces_are_what_the_paper_describes() -> None:
    report = FORCES.run()
    assert {finding.verdict for finding in report.findings} == {"holds"}
    small, large = (report.laws[name][0] for name in ("arena-4x6-10", "arena-30x40"))
    assert (small.repulsion_distance, small.attraction_distance) == (0.1, 0.5)
    assert (large.repulsion_distance, large.attraction_distance) == (2.2, 3.3)
    assert max(map(len, printed(verdicts(report.findings)).splitlines())) <= 80


def test_the_checks_find_a_law_that_is_otherwise() -> None:
    printed_law = LawParameters(sign=-1.0)
    assert checks.zones(printed_law, 1.0, "4 x 6 m").verdict == "contradicted"
    ranges, distances = np.full((3, 8), 0.15), np.array([0.02, 0.05, 0.1])
    ranges[:, 4] = distances  # what is met lies along -x
    law = LawParameters()
    forces = np.zeros((3, 3))
    forces[:, 0] = 1.0 / distances  # 1 / d, not 1 / d^2
    wrong = checks.Sensed(np.zeros((3, 3)), ranges, forces)
    assert checks.obstacle_decay(wrong, np.array([1.0, 0.0, 0.0]), distances, law).verdict == "contradicted"
    assert checks.away_from_obstacles(wrong, np.tile([-1.0, 0.0, 0.0], (3, 1))).verdict == "contradicted"


def test_pictures_of_the_forces_are_written(tmp_path: Path) -> None:
    files = FORCES.run(first_seed=3).write(tmp_path)
    assert set(files) == {path.name for path in tmp_path.iterdir()}
    assert sum(name.endswith(".png") for name in files) == 4


# --- flights


def brief(case: Case) -> Case:
    """The same with three robots and a plume and a flight of a few seconds."""
    changes: dict[str, Any] = {"plume.development": 1.0, "ending.time_limit": 4.0, "team.n_uavs": 3}
    return replace(case, cell=replace(case.cell, scenario=case.cell.scenario.override(**changes)))


def test_a_short_flight_of_the_plumbing() -> None:
    planned = {SHARED: [brief(case) for case in planned_cases(("swarm_ablation",), 2)[SHARED]]}
    runs = fly_settings(planned, n_jobs=1, store=None, progress=False)
    pool = Pool(runs)
    report = SwarmReport(SMALL, runs, pool, [])
    assert [len(layout.records) for layout in runs[0].layouts] == [1, 1]
    assert runs[0].records[0].search_time == runs[0].limit == 4.0
    assert report.rows()[0]["success_rate"] == 0.0
    assert "small" in PAPERS["swarm"].names


def test_a_film_has_its_first_and_last_moment_and_its_pages(small: dict[Setting, list[Case]]) -> None:
    case = brief(small[Setting(FULL, 10, 0.02, 15)][0])
    made = film(case.cell)
    assert made.tracks.shape == (len(made.times), 3, 2)
    assert [made.moments[0].step, made.moments[-1].step] == [0, len(made.times) - 1]
    figure = snapshots(made, "title")
    assert len(figure.axes) == 7  # six moments and the scale
    first = next(pages(made, "title"))
    assert min(first.size) > 300


def test_experiments_have_the_names_of_the_command_line() -> None:
    assert list(EXPERIMENTS) == ["small", "large", "concentration", "forces", "snapshots"]
