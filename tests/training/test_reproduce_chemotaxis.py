"""`osl reproduce chemotaxis`: cells and their statistics, claims, tables, and flights that are flown and drawn."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console, RenderableType

from osl_env.errors import InputError
from osl_env.record import EpisodeRecord
from osl_env.scenario_files import load_scenario
from training.cli import main
from training.figures import write_png
from training.records import EpisodeRecords
from training.reproduce.chemotaxis import EXPERIMENTS, cells, claims, published
from training.reproduce.chemotaxis.cells import BASE, FlownCell, Part, Planned, planned_cells
from training.reproduce.chemotaxis.experiment import CellExperiment, CellReport
from training.reproduce.chemotaxis.parameters import EXPERIMENT as PARAMETERS
from training.reproduce.chemotaxis.pictures import draw_height, draw_plan, flight_picture, legend_marks, overview
from training.reproduce.chemotaxis.tables_of_paper import ALL, PARTS
from training.reproduce.chemotaxis.tracks import Track, fly_track
from training.reproduce.report import verdicts
from training.statistics import wilson
from training.sweep import run_cells

FIRST_SEED = 100_000
DIRECT = (2, 5)  # a cell whose flight is short


@pytest.fixture(scope="module")
def planned() -> list[Planned]:
    return planned_cells(ALL.parts)


@pytest.fixture(scope="module")
def flown(planned: list[Planned]) -> tuple[FlownCell, Track]:
    """The pinned flight of the cell DIRECT, watched."""
    one = next(one for one in planned if (one.source, one.start) == DIRECT)
    track = fly_track(one.cell, FIRST_SEED)
    return one.flown(EpisodeRecords([track.record])), track


@pytest.fixture(scope="module")
def template(flown: tuple[FlownCell, Track]) -> EpisodeRecord:
    return flown[1].record


def made(one: Planned, template: EpisodeRecord, times: Iterable[float], detection: float = 5.0) -> FlownCell:
    """`one` with flights of `times`, s; NaN is a flight that left the bounds."""
    limit = template.time_limit
    records = [
        replace(
            template,
            seed=FIRST_SEED + k,
            success=not math.isnan(time),
            ended="out_of_bounds" if math.isnan(time) else "success",
            search_time=limit if math.isnan(time) else time,
            first_detection_time=detection,
        )
        for k, time in enumerate(times)
    ]
    return one.flown(EpisodeRecords(records))


def all_made(
    planned: Sequence[Planned], template: EpisodeRecord, scale: float = 1.0, spread: float = 0.1
) -> list[FlownCell]:
    """Every cell with ten flights about `scale` times the published one."""
    around = scale * np.linspace(1.0 - spread, 1.0 + spread, 10)
    return [made(one, template, published.flight_time(one.source, one.start) * around) for one in planned]


def printed(content: RenderableType) -> str:
    """What a terminal of 80 columns shows."""
    console = Console(width=80, file=io.StringIO(), record=True)
    console.print(content)
    return console.export_text()


# --- what is flown


def test_cells_are_the_paper_s_sources_and_starts(planned: list[Planned]) -> None:
    """The presets' starts one by one, the sources at the published heights, in the paper's coordinates."""
    starts = load_scenario("puff-source1").team.starts
    paper_starts = [(15, -12, 4), (18, 12, 10), (16, 0, 8), (17, -8, 6), (15, 10, 9)]
    assert [(one.source, one.start) for one in planned] == [(s, i) for s in (1, 2, 3) for i in range(1, 6)]
    for one in planned:
        scenario = one.cell.scenario
        assert scenario.team.n_uavs == 1
        assert scenario.team.starts == (starts[one.start - 1],)
        assert np.add(scenario.team.starts[0], published.PAPER_ORIGIN).tolist() == list(paper_starts[one.start - 1])
        height = {1: 2.0, 2: 6.0, 3: 10.0}[one.source]
        assert np.add(scenario.sources.positions[0], published.PAPER_ORIGIN).tolist() == [0.0, 0.0, height]
        assert (scenario.ending.success, scenario.ending.success_radius) == ("reach", 2.0)
        assert one.cell.seeds == tuple(range(FIRST_SEED, FIRST_SEED + 20))
        assert one.cell.policy.name == "chemotaxis"
        assert math.isinf(one.cell.policy.lost_time)  # type: ignore[attr-defined]


def test_tables_and_all_cells_share_their_episodes(planned: list[Planned]) -> None:
    for source in (1, 2, 3):
        table = EXPERIMENTS[f"table{source}"]
        assert isinstance(table, CellExperiment)
        keys = [one.cell.key for one in planned_cells(table.parts)]
        assert keys == [one.cell.key for one in planned if one.source == source]
    base = [one.cell.key for one in planned_cells(PARAMETERS.parts) if one.setting == BASE]
    assert base == [one.cell.key for one in planned if one.source == 1]


def test_the_study_varies_one_parameter_at_a_time() -> None:
    """Every setting differs from the base in one value of the scenario or of the policy."""
    settings: dict[str, list[Planned]] = {}
    for one in planned_cells(PARAMETERS.parts, 1):
        settings.setdefault(one.setting, []).append(one)
    assert list(settings) == [BASE, "u = 3.0 m/s", "c_thresh = 0.08", "N = 10", "N = 40"]
    wanted: dict[str, dict[str, Any]] = {
        "u = 3.0 m/s": {"wind": {"velocity": (3.0, 0.0, 0.0)}},
        "c_thresh = 0.08": {"gas_sensor": {"threshold": 0.08}},
        "N = 10": {"window": 10},
        "N = 40": {"window": 40},
    }
    for setting, change in wanted.items():
        for one, base in zip(settings[setting], settings[BASE], strict=True):
            if "window" in change:
                assert one.cell.scenario == base.cell.scenario
                assert one.cell.policy == base.cell.policy.model_copy(update=change)
            else:
                assert one.cell.policy == base.cell.policy
                assert one.cell.scenario == base.cell.scenario.override(**change)
                assert one.cell.scenario != base.cell.scenario


def test_a_benchmark_without_the_starts_is_refused() -> None:
    with pytest.raises(InputError, match=r"muc_osl_example: scenarios: label .* must be one of Initial 1"):
        planned_cells((Part("muc_osl_example", 1),))


# --- statistics


def test_failures_are_counted_and_enter_no_time(planned: list[Planned], template: EpisodeRecord) -> None:
    cell = made(planned[0], template, [10.0, math.nan, 20.0, 30.0])
    assert cell.times.tolist() == [10.0, 20.0, 30.0]
    assert (cell.mean.value, cell.median, cell.n_successes) == (20.0, 20.0, 3)
    assert cell.spread == (12.0, 28.0)  # linear between the three
    assert cell.success == wilson(3, 4)
    assert cell.failures == "1 out of bounds"
    assert cell.pinned_time == 10.0
    assert cell.ratio.value == pytest.approx(20.0 / 13.10)
    assert cell.ratio.low == pytest.approx(cell.mean.low / 13.10)
    assert cells.capped_mean([cell]) == pytest.approx((60.0 + template.time_limit) / 4)


def test_a_cell_without_success_or_detection_has_no_times(planned: list[Planned], template: EpisodeRecord) -> None:
    cell = made(planned[0], template, [math.nan, math.nan], detection=math.nan)
    assert all(math.isnan(value) for value in (*cell.mean, cell.median, *cell.spread, cell.pinned_time, *cell.ratio))
    assert math.isinf(cell.detection)
    assert cell.success.value == 0.0
    assert math.isnan(cells.mean_over_starts([cell, made(planned[1], template, [20.0])]).value)


def test_difference_of_means_is_that_of_the_means(planned: list[Planned], template: EpisodeRecord) -> None:
    """The interval covers a normal one: standard error from the cells' variances, within 10 % of its width."""
    rng = np.random.default_rng(3)
    fast = [made(one, template, rng.normal(20.0 + one.start, 2.0, 40)) for one in planned[:5]]
    slow = [made(one, template, rng.normal(30.0 + one.start, 3.0, 40)) for one in planned[5:10]]
    difference = cells.difference_of_means(slow, fast)
    means = [np.mean([cell.times.mean() for cell in group]) for group in (slow, fast)]
    assert difference.value == pytest.approx(means[0] - means[1])
    error = math.sqrt(sum(cell.times.var() / 40 for cell in (*slow, *fast))) / 5
    assert difference.high - difference.low == pytest.approx(2 * 1.96 * error, rel=0.1)


def test_only_the_base_has_published_times(planned: list[Planned], template: EpisodeRecord) -> None:
    cell = made(planned[0]._replace(setting="N = 10"), template, [10.0, 20.0])
    assert math.isnan(cell.paper)
    assert math.isnan(cell.ratio.value)
    assert cell.name == "Source 1 / Initial 1, N = 10"


# --- claims


def test_claims_hold_for_the_published_times(planned: list[Planned], template: EpisodeRecord) -> None:
    """Flights as published confirm all that is claimed of times and successes."""
    flights = all_made(planned, template)
    decided: list[claims.CellClaim] = [
        claims.PinnedFlightsSucceed(),
        claims.CellsAlwaysSucceed(13),
        claims.FlightsSucceed(0.95),
        claims.SourcesInOrder(),
        claims.MostDetectWithin(20.0),
    ]
    findings = [claim.check(flights) for claim in decided]
    assert [finding.verdict for finding in findings] == ["holds"] * 5
    assert "15 of 15" in findings[0].ours


def test_claims_follow_the_failures(planned: list[Planned], template: EpisodeRecord) -> None:
    flights = all_made(planned, template)
    lost = [math.nan, *[20.0] * 9]
    flights[:2] = [made(one, template, lost, detection=math.nan) for one in planned[:2]]
    pinned = claims.PinnedFlightsSucceed().check(flights)
    assert pinned.verdict == "contradicted"
    assert pinned.ours.startswith("seed 100000: 13 of 15; failed: Source 1 / Initial 1 (out of bounds), Source 1")
    assert claims.CellsAlwaysSucceed(13).check(flights).verdict == "holds"
    assert claims.CellsAlwaysSucceed(14).check(flights).verdict == "contradicted"
    assert claims.FlightsSucceed(0.95).check(flights).verdict == "holds"  # 148 of 150: above 95.3
    assert claims.FlightsSucceed(0.97).check(flights).verdict == "open"
    assert claims.FlightsSucceed(0.999).check(flights).verdict == "contradicted"
    late = claims.MostDetectWithin(20.0).check(flights)
    assert late.verdict == "holds"
    assert "13 of 15; later: Source 1 / Initial 1 inf s" in late.ours
    assert claims.MostDetectWithin(4.0).check(flights).verdict == "contradicted"


def test_the_order_of_sources_is_decided_by_its_intervals(planned: list[Planned], template: EpisodeRecord) -> None:
    flights = all_made(planned, template)
    assert claims.SourcesInOrder((3, 2, 1)).check(flights).verdict == "contradicted"
    wide = all_made(planned, template, spread=0.99)
    rng = np.random.default_rng(0)
    same = [made(one, template, rng.normal(20.0, 5.0, 10)) for one in planned]
    assert claims.SourcesInOrder().check(same).verdict in ("open", "contradicted")
    assert claims.SourcesInOrder().check(wide).ours.count("[") == 5  # three means, two differences
    none = [*flights[:-1], made(planned[-1], template, [math.nan])]
    assert claims.SourcesInOrder().check(none).verdict == "open"


def test_the_climb_is_checked_by_its_detection_time(planned: list[Planned], template: EpisodeRecord) -> None:
    place = next(k for k, one in enumerate(planned) if (one.source, one.start) == published.CLIMB_CELL)
    for detection, verdict in ((77.0, "holds"), (70.0, "holds"), (60.0, "contradicted"), (math.nan, "contradicted")):
        cell = made(planned[place], template, [88.0, 89.0], detection)
        assert claims.DetectsAtPublishedTime().check([cell]).verdict == verdict
    with pytest.raises(LookupError):
        claims.DetectsAtPublishedTime().check([made(planned[0], template, [1.0])])


# --- tables, files


def reports(planned: Sequence[Planned], template: EpisodeRecord) -> list[CellReport]:
    """Tables with all that makes them wide: long times, failures of several kinds, no detection."""
    flights = all_made(planned, template, scale=5.0)
    flights[1] = made(planned[1], template, [math.nan] * 10, detection=math.nan)
    mixed = made(planned[2], template, [math.nan, math.nan, 590.25, 480.5, *[500.0] * 6])
    mixed.records[1] = replace(mixed.records[1], ended="time")
    flights[2] = mixed
    study = [made(one, template, [20.0 + one.start, 30.0, 100.25]) for one in planned_cells(PARAMETERS.parts, 3)]
    study[7] = made(planned_cells(PARAMETERS.parts, 3)[7], template, [math.nan] * 3)
    return [
        CellReport(ALL, flights, [claim.check(flights) for claim in ALL.claims[:5]]),
        CellReport(PARAMETERS, study, [claim.check(study) for claim in PARAMETERS.claims]),
    ]


def test_tables_fit_a_terminal_and_files_hold_every_cell(
    planned: list[Planned], template: EpisodeRecord, tmp_path: Path
) -> None:
    for report in reports(planned, template):
        assert "…" not in printed(report.tables())  # nothing is cut off
        assert "contradicted" in printed(verdicts(report.findings))
        folder = tmp_path / report.name
        assert set(report.write(folder)) == {entry.name for entry in folder.iterdir()}
        notes = (folder / "notes.md").read_text()
        assert "nan" not in notes
        assert notes.count("| Source 1 / Initial 1") == (1 if report.name == "tables" else 5)
        table = (folder / "table.csv").read_text().splitlines()
        assert len(table) == 1 + len(report.cells)
        episodes = (folder / "episodes.csv").read_text().splitlines()
        assert len(episodes) == 1 + sum(len(cell.records) for cell in report.cells)
        json.dumps(report.rows(), allow_nan=False)


def test_strips_say_what_is_ours_and_what_the_paper_s(planned: list[Planned], template: EpisodeRecord) -> None:
    for report, panels in zip(reports(planned, template), (3, 5), strict=True):
        figure = report.figure()
        assert len(figure.axes) == panels
        assert [text.get_text() for text in figure.legends[0].get_texts()] == [
            "ours, one flight a seed", "ours, 10-90 % of the seeds", "ours, median", "ours, pinned seed", "paper",
        ]  # fmt: skip
        assert figure.axes[0].get_xlabel() == "flight time, s"
        assert is_png(figure)


def is_png(figure: Figure) -> bool:
    file = io.BytesIO()
    write_png(figure, file, dpi=40)
    return file.getvalue().startswith(b"\x89PNG")


# --- flights


def test_a_watched_flight_is_the_flight_of_the_record(flown: tuple[FlownCell, Track]) -> None:
    """Watching changes nothing; the track begins at the start, is gapless, and ends within reach of the source."""
    cell, track = flown
    alone = run_cells([replace(cell.cell, seeds=(FIRST_SEED,))], n_jobs=1, progress=False)[0][0]
    of_runner = {"parameters", "scenario_hash", "decision_seconds"}
    recorded, watched = ({k: v for k, v in r.to_dict().items() if k not in of_runner} for r in (alone, track.record))
    assert recorded == watched
    assert track.times[-1] == pytest.approx(track.record.mission_time)
    assert np.allclose(np.diff(track.times), cell.cell.scenario.decision_time)
    start = np.add(cell.cell.scenario.team.starts[0], published.PAPER_ORIGIN)
    assert np.allclose(track.positions[0], start)
    if track.record.success:
        distance = float(np.linalg.norm(track.positions[-1] - (0.0, 0.0, 6.0)))
        assert distance <= cell.cell.scenario.ending.success_radius
    switches = [(a, b) for a, b in zip(track.modes, track.modes[1:], strict=False) if a != b]
    assert switches == [("scan", "search")]  # for good
    first = track.times[np.argmax(track.detected)]
    assert first == pytest.approx(track.record.first_detection_time, abs=cell.cell.scenario.decision_time)


def test_pictures_of_a_flight(flown: tuple[FlownCell, Track]) -> None:
    cell, track = flown
    names = [str(mark.get_label()) for mark in legend_marks(track)]
    assert names == ["scan", "search", "start", "first detection", "source"]
    picture = flight_picture(cell, track)
    titles = {axes.get_title() for axes in picture.axes}
    assert {"path by mode", "path by concentration", "from above"} <= titles
    labels = {axes.get_xlabel() for axes in picture.axes} | {axes.get_ylabel() for axes in picture.axes}
    assert {"x, m", "y, m", "z, m", "time, s", "concentration"} <= labels
    assert is_png(picture)
    for draw, labelled in ((draw_plan, ("x, m", "y, m")), (draw_height, ("time, s", "z, m"))):
        assert is_png(overview([flown], "one flight", draw, labelled))


def test_a_flight_without_gas_can_be_drawn(flown: tuple[FlownCell, Track]) -> None:
    cell, track = flown
    blank = replace(track, readings=np.zeros_like(track.readings))
    assert math.isnan(blank.detection_height)
    assert "first detection" not in [mark.get_label() for mark in legend_marks(blank)]
    assert is_png(flight_picture(cell, blank))


def test_the_command_flies_a_table_and_takes_it_from_the_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["reproduce", "chemotaxis", "table2", "--episodes", "1", "--jobs", "1"]
    assert main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    rows = told[0]["rows"]
    assert [row["paper_time"] for row in rows] == list(published.FLIGHT_TIMES[2])
    assert [row["episodes"] for row in rows] == [1] * 5
    assert all(row["successes"] == 1 or row["failures"] for row in rows)
    assert {finding["verdict"] for finding in told[0]["findings"]} <= {"holds", "contradicted", "open"}
    kept = {path: path.read_bytes() for path in (tmp_path / "results" / "store").iterdir()}
    assert main(words) == 0
    shown = capsys.readouterr().out
    assert "ours / paper" in shown
    assert max(map(len, shown.splitlines())) <= 80
    assert kept == {path: path.read_bytes() for path in (tmp_path / "results" / "store").iterdir()}
    files = {path.name for path in (tmp_path / "results" / "reproduce" / "chemotaxis" / "table2").iterdir()}
    assert files == {"figure.png", "notes.md", "table.csv", "episodes.csv"}


@pytest.mark.slow
def test_trajectories_are_drawn_for_all_cells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["reproduce", "chemotaxis", "trajectories"]) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
    names = {path.name for path in (tmp_path / "results" / "reproduce" / "chemotaxis" / "trajectories").iterdir()}
    flights = {f"source{source}-initial{start}.png" for source in PARTS for start in range(1, 6)}
    assert names == flights | {"overview.png", "heights.png", "notes.md", "table.csv", "tracks.csv"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["chemotaxis", "trajectory"], "did you mean 'trajectories'"),
        (["chemotaxis", "figure"], "allowed are table1, table2, table3, tables, parameters, trajectories, all"),
        (["chemotaxi"], "did you mean 'chemotaxis'"),
        (["chemotaxis", "table1", "--episodes", "0"], "--episodes 0"),
        (["chemotaxis", "table1", "--seed", "-1"], "--seed -1"),
        (["chemotaxis", "table1", "--jobs", "0"], "n_jobs = 0"),
        (["chemotaxis", "trajectories", "--jobs", "-2"], "n_jobs = -2"),
        (["chemotaxis", "table1", "--out", "/proc/none"], "/proc/none"),
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
