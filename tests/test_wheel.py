"""The wheel, installed into an empty folder, works outside the repository."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent


def pip(*arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", *arguments],
        check=True,
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(REPOSITORY))
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("installed")
    pip("install", "--no-deps", "--target", str(folder), str(wheel))
    return folder


def osl(installed: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, str(installed / "bin" / "osl"), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def test_the_wheel_holds_packages_and_configurations_and_nothing_else(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert tops == {"osl_env", "baselines", "training"}
    assert "osl_env/configs/scenarios/rate-100x60x30.yaml" in names
    assert "osl_env/configs/benchmarks/demo.yaml" in names
    assert {"training/report_page/table.js", "training/report_page/style.css"} <= set(names)
    trainings = [path.name for path in (REPOSITORY / "configs" / "training").glob("*.yaml")]
    assert trainings
    assert {f"osl_env/configs/training/{name}" for name in trainings} <= set(names)
    fields = [path.name for path in (REPOSITORY / "configs" / "fields").glob("*.npz")]
    assert fields
    assert {f"osl_env/configs/fields/{name}" for name in fields} <= set(names)
    kinds = (".py", ".yaml", ".safetensors", "py.typed", ".js", ".css", ".npz")
    assert not [name for name in names if not name.endswith(kinds) and ".dist-info/" not in name]
    assert [name for name in names if name.endswith("licenses/LICENSE")]


@pytest.mark.slow
def test_it_works_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    where = subprocess.run(
        [sys.executable, "-c", "import osl_env, training; print(osl_env.__file__, training.__file__)"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert where.stdout.count(str(installed)) == 2
    listed = osl(installed, tmp_path, "list", "--json")
    assert listed.returncode == 0, listed.stderr
    assert "rate-100x60x30" in json.loads(listed.stdout)["scenarios"]
    run = osl(installed, tmp_path, "run", "random-walk", "rate-60x60x30", "--episodes", "2", "--jobs", "1", "--json",
              "--set", "ending.time_limit=60")  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert [episode["seed"] for episode in json.loads(run.stdout)["episodes"]] == [0, 1]
    refused = osl(installed, tmp_path, "run", "random-walk", "rate-60x60x3")
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)


@pytest.mark.slow
def test_the_shipped_agents_fly_without_torch(installed: Path, tmp_path: Path) -> None:
    blocked = tmp_path / "blocked"
    blocked.mkdir()
    for package in ("torch", "stable_baselines3", "sb3_contrib"):
        (blocked / f"{package}.py").write_text("raise ImportError('not installed')")
    code = (
        "from baselines import make_policy\nfrom baselines.policy import SHIPPED_CHECKPOINTS\n"
        "from training import evaluate\n"
        "for name in SHIPPED_CHECKPOINTS:\n"
        "    print(name, len(evaluate(make_policy(name), 'rate-60x60x30', seeds=[0], progress=False)))\n"
    )
    path = os.pathsep.join([str(blocked), str(installed)])
    flown = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert flown.returncode == 0, flown.stderr
    assert flown.stdout.split()[::2] == ["rppo-raw", "ppo-belief"]
