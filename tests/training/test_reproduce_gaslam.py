"""`osl reproduce gaslam`: runs and what is left out, averages, claims, tables, pictures, and a short flight."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console, RenderableType

from baselines import make_policy
from baselines.gaslam.cells import Cells
from osl_env.errors import InputError
from osl_env.record import EpisodeRecord
from osl_env.scenario_files import load_scenario
from osl_env.world import World
from training.benchmark import Case
from training.cli import main
from training.figures import write_png
from training.gas_mapping import merit
from training.reproduce.gaslam import EXPERIMENTS, claims, tables
from training.reproduce.gaslam.averages import (
    MEASURES,
    by_setting,
    difference,
    empty_estimate,
    estimate,
    over_cases,
    ratio,
    succeeded,
)
from training.reproduce.gaslam.experiment import GasExperiment, GasReport
from training.reproduce.gaslam.figures import error_boxes
from training.reproduce.gaslam.map_pictures import MapPictures, MapReport
from training.reproduce.gaslam.mapped import GasMaps, maps_of
from training.reproduce.gaslam.pictures import five_maps
from training.reproduce.gaslam.published import TABLE2, published
from training.reproduce.gaslam.runs import Flown, Landed, Run, fly_cases, planned_cases
from training.reproduce.report import verdicts
from training.statistics import bootstrap_mean
from training.sweep import Cell

FIRST_SEED = 100_000
CELLS = Cells(np.zeros(3), np.array([7.0, 2.0, 0.5]), (7, 4, 2))
SOURCE = np.array([0.5, 1.5, 0.3])
TRUTH = np.where(np.arange(CELLS.n) < 8, 100.0, 0.0)  # gas in the cells of the lowest x


@pytest.fixture(scope="module")
def template() -> EpisodeRecord:
    world = World(load_scenario("tunnel-a-random", **{"plume.development": 0.1}))
    world.reset([FIRST_SEED])
    return EpisodeRecord.of(world, 0, "gaslam")


def made(record: EpisodeRecord, error: Sequence[float] | None, seed: int = FIRST_SEED, noise: float = 0.0) -> Run:
    """A run that declares `error` (3,), m, from the source, or nothing; its map is the truth plus `noise`."""
    declared = None if error is None else SOURCE + error
    maps = GasMaps(CELLS, TRUTH + noise, np.linspace(0.0, 0.99, CELLS.n), TRUTH + 2 * noise, TRUTH + noise)
    track = np.array([[6.8, 0.2, 0.1], [3.0, 1.0, 0.2], [0.6, 1.4, 0.3]])
    return Run(Landed(replace(record, seed=seed), SOURCE, declared, maps, track), TRUTH, 5.0)


def flown(record: EpisodeRecord, case: str, setting: str, errors: Sequence[Any], noise: float = 5.0) -> Flown:
    """Runs with seeds in order; an error is (3,) m, or one number along x."""
    runs = [
        made(record, (error, 0.0, 0.0) if isinstance(error, float) else error, FIRST_SEED + k, noise)
        for k, error in enumerate(errors)
    ]
    scenario = load_scenario(f"tunnel-{case.lower()}-random")
    seeds = tuple(run.seed for run in runs)
    return Flown(Case(case, setting, None, Cell(make_policy("gaslam"), scenario, seeds)), tuple(runs))


def printed(content: RenderableType) -> str:
    """What a terminal of 80 columns shows."""
    console = Console(width=80, file=io.StringIO(), record=True)
    console.print(content)
    return console.export_text()


# --- what is published, and what is flown


def test_m_of_the_published_rows_is_that_of_their_averages() -> None:
    """To 1e-4: the rows' four digits leave an error of 5e-5 / 0.37 in PE and of 5e-5 in SC, 3e-4 of M at most."""
    assert set(TABLE2) == {"A", "D"}
    for row in TABLE2.values():
        assert merit(row["sc"], row["rmse"], row["pe"]) == pytest.approx(row["m"], abs=1e-4)


def test_table_two_is_ten_runs_a_case_with_the_source_drawn_anew() -> None:
    cases = planned_cases("gaslam_table2")
    assert [(one.scenario, one.cell.scenario.name) for one in cases if one.policy == "gaslam"] == [
        (case, f"tunnel-{case.lower()}-random") for case in "ABCD"
    ]
    assert {one.cell.seeds for one in cases} == {tuple(range(FIRST_SEED, FIRST_SEED + 10))}
    assert {one.policy for one in cases} == {"gaslam", "rahbar-ste", "boustrophedon-ste", "kernel-peak"}
    real = planned_cases("gaslam_real", 2, 7)
    assert {one.cell.seeds for one in real} == {(7, 8)}
    for one in real:
        assert one.cell.scenario.wind.changes
        assert one.cell.scenario.gas_sensor.rise_time == one.cell.scenario.gas_sensor.recovery_time == 1.0


def test_ablations_differ_from_the_base_in_one_parameter() -> None:
    cases = [one for one in planned_cases("gaslam_ablation", 1) if one.scenario == "A"]
    base = cases[0].cell.policy.model_dump()
    assert (cases[0].policy, base) == ("base", make_policy("gaslam").model_dump())
    changed = {
        one.policy: {key: value for key, value in one.cell.policy.model_dump().items() if value != base[key]}
        for one in cases[1:]
    }
    assert changed == {
        "all cells": {"used_cells": "all"},
        "entropy weights": {"weighting": "printed"},
        "equal weights": {"weighting": "equal"},
        "printed vectors": {"vectors": "printed"},
        "printed V_diff": {"difference": "printed"},
    }
    experiment = EXPERIMENTS["ablation"]
    assert isinstance(experiment, GasExperiment)
    assert {claim.setting for claim in experiment.claims if isinstance(claim, claims.Worsens)} == set(changed)


# --- runs and averages


def test_a_run_fails_by_its_error_along_x_or_without_a_declaration(template: EpisodeRecord) -> None:
    assert not made(template, (5.0, 0.0, 0.0)).failed
    assert made(template, (5.01, 0.0, 0.0)).failed
    assert not made(template, (4.0, 4.0, 4.0)).failed
    silent = made(template, None)
    assert silent.failed
    assert math.isnan(silent.pe)
    assert np.isnan(silent.offset).all()


def test_figures_of_a_run(template: EpisodeRecord) -> None:
    run = made(template, (3.0, 0.0, -4.0), noise=10.0)
    assert run.pe == 5.0
    assert (run.rmse, run.rmse_ste) == pytest.approx((0.1, 0.2))  # over the truth's largest, 100
    assert run.sc == 1.0
    assert (run.empty_rmse, run.empty_sc) == pytest.approx((math.sqrt(8 / 56), 48 / 56))
    without = replace(run.landed.maps, plume=None)
    assert math.isnan(Run(replace(run.landed, maps=without), TRUTH, 5.0).rmse_ste)


def test_failed_runs_enter_no_average(template: EpisodeRecord) -> None:
    one = flown(template, "A", "gaslam", [0.2, 0.4, 6.0, None])
    assert (len(one.kept), succeeded([one]).value) == (2, 0.5)
    assert estimate(one, "pe").value == pytest.approx(0.3)
    assert estimate(one, "pe") == pytest.approx(bootstrap_mean([0.2, 0.4]))
    assert one.axis_errors() == pytest.approx(np.array([[0.2, 0.0, 0.0], [0.4, 0.0, 0.0]]))
    assert ratio(one, "pe").value == pytest.approx(0.3 / 0.3732)
    other = flown(template, "A", "rival", [0.3, 0.4, 6.5, 1.0])
    # the failed pair counts; without a declaration there is no pair: (-0.1 + 0 - 0.5) / 3
    assert difference([one], [other], "pe").value == pytest.approx(-0.2)


def test_m_is_of_the_averages_with_an_interval_about_it(template: EpisodeRecord) -> None:
    one = flown(template, "D", "gaslam", [0.1, 0.2, 0.3, 0.4, 0.5])
    m = estimate(one, "m")
    assert m.value == pytest.approx(merit(1.0, 0.05, 0.3))
    # SC and RMSE are equal in all runs: the interval is that of 0.95 / PE
    pe = bootstrap_mean([0.1, 0.2, 0.3, 0.4, 0.5])
    assert 0.95 / pe.high * 0.85 < m.low < m.value < m.high < 0.95 / pe.low * 1.15


def test_few_runs_have_no_interval_and_none_no_value(template: EpisodeRecord) -> None:
    alone, lost = flown(template, "A", "gaslam", [0.2]), flown(template, "A", "gaslam", [6.0, None])
    for measure in MEASURES:
        assert math.isnan(estimate(alone, measure).low)
        assert not math.isnan(estimate(alone, measure).value)
        assert math.isnan(estimate(lost, measure).value)
    assert math.isnan(over_cases([alone], "pe").low)
    assert over_cases([alone, lost], "pe").value == pytest.approx(0.2)
    assert math.isnan(empty_estimate(lost, "pe").value)
    assert empty_estimate(lost, "sc").value == pytest.approx(48 / 56)
    assert math.isnan(ratio(flown(template, "B", "gaslam", [0.2, 0.3]), "pe").value)  # not at hand


# --- claims


def decided(claim: claims.GasClaim, runs: Sequence[Flown]) -> str:
    return claim.check(runs).verdict


def test_claims_follow_the_intervals(template: EpisodeRecord) -> None:
    good = [flown(template, case, "gaslam", [0.1, 0.2] * 5) for case in "AD"]
    bad = [flown(template, case, "gaslam", [1.1, 1.2] * 4 + [6.0] * 2) for case in "AD"]
    mixed = [flown(template, case, "gaslam", [0.1, 1.0] * 5) for case in "AD"]
    for runs, verdict in ((good, "holds"), (bad, "contradicted"), (mixed, "open")):
        assert decided(claims.AsGoodAsPublished("D", "pe"), runs) == verdict
        assert decided(claims.ErrorBelow(0.6), runs) == verdict
        assert decided(claims.AsGoodAsPublished("A", "m"), runs) == verdict
    assert decided(claims.RunsSucceed(), good) == "holds"
    assert decided(claims.RunsSucceed(), bad) == "contradicted"  # 16 of 20: Wilson's interval ends at 92 %
    assert decided(claims.RunsSucceed(), [*good[:1], bad[1]]) == "open"  # 18 of 20: at 97 %
    assert decided(claims.MapsBetterThanNothing("rmse"), good) == "holds"
    rivals = [flown(template, case, "kernel-peak", [0.5, 0.7] * 5) for case in "AD"]
    assert decided(claims.Places("kernel-peak"), [*good, *rivals]) == "holds"
    assert decided(claims.Places("kernel-peak"), [*bad, *rivals]) == "contradicted"
    assert decided(claims.Worsens("kernel-peak", "worse"), [*good, *rivals]) == "holds"
    nothing = [flown(template, case, "gaslam", [None] * 3) for case in "AD"]
    assert decided(claims.ErrorBelow(0.6), nothing) == "open"


# --- tables, files, pictures


def reports(template: EpisodeRecord) -> list[GasReport]:
    """All that makes tables wide: long names, large errors, failed runs, a setting that always fails."""
    table, ablation = EXPERIMENTS["real"], EXPERIMENTS["ablation"]
    assert isinstance(table, GasExperiment)
    assert isinstance(ablation, GasExperiment)
    errors: dict[str, list[Any]] = {
        "gaslam": [0.1, 0.2, 0.3], "rahbar-ste": [2.1, 2.5, 3.5], "boustrophedon-ste": [6.0, None, 6.5],
        "kernel-peak": [0.5, None, 4.9],
    }  # fmt: skip
    flights = [flown(template, case, name, given) for case in "ABCD" for name, given in errors.items()]
    settings = ["base", *(claim.setting for claim in ablation.claims if isinstance(claim, claims.Worsens))]
    study = [flown(template, case, name, [0.2, 3.5, 1.0 + k]) for case in "AB" for k, name in enumerate(settings)]
    return [
        GasReport(table, flights, [claim.check(flights) for claim in table.claims]),
        GasReport(ablation, study, [claim.check(study) for claim in ablation.claims]),
    ]


def test_tables_fit_a_terminal_and_files_hold_every_run(template: EpisodeRecord, tmp_path: Path) -> None:
    for report in reports(template):
        assert "…" not in printed(report.tables())  # nothing is cut off
        assert "holds" in printed(verdicts(report.findings))
        folder = tmp_path / report.name
        assert set(report.write(folder)) == {entry.name for entry in folder.iterdir()}
        assert "nan" not in (folder / "notes.md").read_text()
        cases = len({one.name for one in report.flown})
        assert len((folder / "table.csv").read_text().splitlines()) == 1 + len(report.flown) + cases  # and no gas
        lines = (folder / "episodes.csv").read_text().splitlines()
        assert len(lines) == 1 + sum(len(one.runs) for one in report.flown)
        rows = json.loads(json.dumps(report.rows(), allow_nan=False))
        assert {row["setting"] for row in rows} == {*by_setting(report.flown), tables.NO_GAS}
        assert all(row["paper_pe"] == TABLE2["A"]["pe"] for row in rows if row["case"] == "A" and row["policy"])


def test_the_trivial_map_stands_beside_in_every_case(template: EpisodeRecord) -> None:
    header, rows = tables.beside_each_other(reports(template)[0].flown)
    trivial = [dict(zip(header, row, strict=True)) for row in rows if row[1] == tables.NO_GAS]
    assert len(trivial) == 4
    assert {(row["SC"], row["PE, m [95 %]"]) for row in trivial} == {(f"{48 / 56:.3f}", "-")}


def test_boxes_of_errors_by_axis(template: EpisodeRecord) -> None:
    figure = error_boxes(reports(template)[0].flown, "errors")
    assert [axes.get_title() for axes in figure.axes] == ["PE", "along x (the wind)", "along y", "along z (up)"]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["gaslam", "rahbar-ste", "boustrophedon-ste", "kernel-peak", "the paper's mean PE"]
    assert is_png(figure)


@pytest.mark.parametrize("lacking", [False, True])
def test_five_maps_are_drawn_whatever_is_lacking(template: EpisodeRecord, lacking: bool) -> None:
    """Lacking: a declaration, a source term, and any gas in the truth."""
    run = made(template, None if lacking else (0.1, 0.0, 0.0), noise=3.0)
    if lacking:
        maps = replace(run.landed.maps, plume=None)
        run = Run(replace(run.landed, maps=maps), np.zeros_like(TRUTH), 5.0)
    figure = five_maps(run, "five maps")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    for name in ("truth", "kernel map", "confidence", "source term's map", "final map"):
        assert any(title.startswith(name) for title in titles)
    assert is_png(figure)


def test_a_case_s_maps_are_written_with_their_figures(template: EpisodeRecord, tmp_path: Path) -> None:
    experiment = EXPERIMENTS["maps"]
    assert isinstance(experiment, MapPictures)
    report = MapReport(experiment, [flown(template, "D", "gaslam", [None])])
    assert report.write(tmp_path) == ["case-d.png", "notes.md", "table.csv"]
    assert {entry.name for entry in tmp_path.iterdir()} == {"case-d.png", "notes.md", "table.csv"}
    json.dumps(report.rows(), allow_nan=False)


def is_png(figure: Figure) -> bool:
    file = io.BytesIO()
    write_png(figure, file, dpi=40)
    return file.getvalue().startswith(b"\x89PNG")


# --- flights and the command


def short_case(policy: str, seeds: tuple[int, ...]) -> Case:
    scenario = load_scenario("tunnel-d-random", **{"ending.time_limit": 8.0, "plume.development": 5.0})
    return Case("D", policy, None, Cell(make_policy(policy), scenario, seeds))


def test_a_flight_brings_its_maps_and_does_not_depend_on_its_company() -> None:
    together = fly_cases([short_case("gaslam", (3, 4))], n_jobs=1, progress=False)[0]
    alone = fly_cases([short_case("gaslam", (4,))], n_jobs=1, progress=False)[0]
    pair, single = together.runs[1], alone.runs[0]
    assert (pair.seed, single.seed) == (4, 4)
    assert np.array_equal(pair.landed.maps.final, single.landed.maps.final)
    assert np.array_equal(pair.truth, single.truth)
    landed = single.landed
    assert landed.maps.cells.shape == (14, 10, 5)
    assert np.array_equal(landed.track[0], [6.8, 0.2, 0.1])
    assert landed.maps.confidence.max() > 0.5
    assert single.truth.max() > 5.0
    assert single.truth[: 10 * 5].max() <= single.truth.max()


def test_a_policy_without_a_gas_map_is_refused() -> None:
    with pytest.raises(InputError, match="policy random-walk: draws no gas map"):
        maps_of(make_policy("random-walk"))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["gaslam", "table1"], "did you mean 'table2'"),
        (["gaslam", "figures"], "allowed are table2, real, maps, ablation, all"),
        (["gasla"], "did you mean 'gaslam'"),
        (["gaslam", "table2", "--episodes", "0"], "--episodes 0"),
        (["gaslam", "maps", "--seed", "-1"], "--seed -1"),
        (["gaslam", "ablation", "--jobs", "0"], "n_jobs = 0"),
        (["gaslam", "table2", "--out", "/proc/none"], "/proc/none"),
    ],
)
def test_bad_arguments_are_one_line_and_exit_code_two(
    words: list[str], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", *words]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert complaint in err


@pytest.mark.slow
def test_the_command_flies_table_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "gaslam", "table2", "--episodes", "1", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)[0]["rows"]
    assert [row["case"] for row in rows if row["setting"] == "gaslam"] == list("ABCD")
    assert published("A", "pe") in {row.get("paper_pe") for row in rows}
    files = {path.name for path in (tmp_path / "results" / "reproduce" / "gaslam" / "table2").iterdir()}
    assert files == {"figure.png", "notes.md", "table.csv", "episodes.csv"}
