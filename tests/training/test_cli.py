"""The command line: what it prints, and one clear line with exit code 2 for what it cannot do."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import guesser
import pytest

from baselines import policy_names
from osl_env.scenario_files import scenario_names
from training.cli import main
from training.training_config import training_names

assert guesser

RUN = ["run", "guesser", "rate-60x60x30", "--episodes", "2", "--jobs", "1"]


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_run_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(RUN) == 0
    out, err = capsys.readouterr()
    assert "guesser" in out
    assert "SR %" in out
    assert max(map(len, out.splitlines())) <= 80
    assert err == ""


def test_run_json_is_json_only_and_follows_the_settings(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--set", "team.n_uavs=2", "--set", "radio.radius=20 m", "--policy-set", "patience=3", "--seed", "7"]
    assert main([*RUN, *settings, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert [episode["seed"] for episode in content["episodes"]] == [7, 8]
    assert content["episodes"][0]["n_uavs"] == 2
    assert content["episodes"][0]["parameters"]["patience"] == 3
    assert content["summary"]["episodes"] == 2


def test_out_files(empty_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for suffix in ("csv", "json", "parquet"):
        assert main([*RUN, "--out", f"here/episodes.{suffix}"]) == 0
    assert {path.name for path in (empty_folder / "here").iterdir()} == {
        "episodes.csv",
        "episodes.json",
        "episodes.parquet",
    }
    assert capsys.readouterr().err == ""


def test_list_names_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    out = capsys.readouterr().out
    for name in [*policy_names(), *scenario_names(), "muc_osl_area", *training_names()]:
        assert name in out
    assert max(map(len, out.splitlines())) <= 80
    assert main(["list", "policies", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["policies"]["guesser"] == "for tests"
    assert main(["list", "trainings", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["trainings"]["ppo-raw"].startswith("ppo in the environment uav")


def test_listing_trainings_does_without_torch() -> None:
    code = "import sys; from training.cli import main; sys.exit(main(['list', 'trainings']) or 'torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_bench_writes_table_and_figure(empty_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = empty_folder / "small.yaml"
    config.write_text("title: small\nseeds: {count: 3}\nscenarios: [rate-60x60x30]\npolicies: [guesser]\n")
    assert main(["bench", "small.yaml", "--jobs", "1", "--episodes", "2"]) == 0
    assert "results/small" in capsys.readouterr().out
    assert {path.name for path in (empty_folder / "results" / "small").iterdir()} == {
        "table.csv",
        "table.json",
        "episodes.csv",
        "comparisons.csv",
        "report.html",
        "figure.png",
    }
    assert main(["bench", "small.yaml", "--jobs", "1", "--episodes", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rows"][0]["episodes"] == 2


BAD = [
    ([], "Expected one of"),
    (["fly"], "fly"),
    (["run"], "POLICY"),
    (["run", "guesser"], "SCENARIO"),
    ([*RUN, "--episodes", "many"], "--episodes"),
    ([*RUN, "--episodes", "0"], "--episodes 0: must be at least 1"),
    ([*RUN, "--seed", "-1"], "seed = -1"),
    ([*RUN, "--jobs", "0"], "n_jobs = 0"),
    ([*RUN, "--colour", "red"], "--colour"),
    ([*RUN, "--set", "team.n_uavs"], "must be KEY=VALUE"),
    ([*RUN, "--set", "team.n_uavs=0"], "team.n_uavs = 0"),
    ([*RUN, "--set", "team.uavs=3"], "unknown key 'team.uavs'"),
    ([*RUN, "--set", "radio.radius=20 kg"], "radius"),
    ([*RUN, "--set", "radio.radius=.nan"], "must be finite"),
    ([*RUN, "--set", "sources.positions=[[500, 1, 1]]"], "inside the area"),
    ([*RUN, "--set", "a=1", "--set", "a=2"], "twice"),
    ([*RUN, "--policy-set", "patience=0"], "patience = 0"),
    ([*RUN, "--policy-set", "temper=1"], "unknown key 'temper'"),
    ([*RUN, "--out", "episodes.txt"], "suffix must be"),
    ([*RUN, "--out", "/proc/none/episodes.csv"], "/proc/none"),
    ([*RUN, "--render", "picture.gif"], "suffix must be .png"),
    (["run", "gueser", "rate-60x60x30"], "did you mean 'guesser'"),
    (["run", "guesser", "rate-60x60"], "unknown scenario 'rate-60x60'"),
    (["run", "guesser", "nothing.yaml"], "nothing.yaml"),
    (["bench", "nothing"], "unknown benchmark 'nothing'"),
    (["bench", "--episodes", "0"], "--episodes 0"),
    (["list", "planets"], "cannot list 'planets'"),
    (["reproduce", "muc-osl", "aera"], "did you mean 'area'"),
    (["reproduce", "nature"], "unknown paper 'nature'"),
]


@pytest.mark.parametrize(
    ("words", "complaint"), BAD, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_bad_input_is_one_line_and_exit_code_two(
    words: list[str], complaint: str, empty_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("osl: ")
    assert err.count("\n") == 1
    assert complaint in err
    assert not [path for path in empty_folder.rglob("*") if path.is_file()]  # nothing half-written


def test_ctrl_c_is_130(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from training import sweep

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep, "run_batch", stop)
    assert main(RUN) == 130
    assert capsys.readouterr().err.startswith("osl: stopped before any")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("osl-env ")
