"""Training: every algorithm learns, ships and resumes; a resumed training is the uninterrupted one, bit by bit."""

from __future__ import annotations

import json
import os
import shutil
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import numpy as np
import torch
from stable_baselines3 import PPO
from tiny_training import KINDS, config, config_file, content

from baselines import make_policy
from baselines.learned.checkpoint import Checkpoint
from osl_env import InputError
from training import callbacks, evaluate, resume_state
from training.callbacks import Milestones, TrainingStopped
from training.cli import main
from training.held_out import Score
from training.resume_state import SavedState
from training.snapshot import decode
from training.train import Result, train
from training.training_config import make_config


class KilledError(Exception):
    """Stands for the end of the process."""


def state(folder: Path) -> SavedState:
    return SavedState(folder / "last" / "state.safetensors")


def assert_same_state(one: Path, other: Path) -> None:
    """Weights, optimisers, replay buffer, worlds and generators are equal bit by bit; so are the scores."""
    first, second = state(one), state(other)
    assert first._arrays.keys() == second._arrays.keys()
    different = [name for name in first._arrays if first._arrays[name].tobytes() != second._arrays[name].tobytes()]
    assert not different
    for part in ("generators", "scenarios"):
        assert first._content[part] == second._content[part]
    for note in ("scores", "best", "scored_at", "saved_at"):
        assert first.notes[note] == second.notes[note]
    ours, theirs = (Checkpoint.load(folder / "best") for folder in (one, other))
    assert all(np.array_equal(ours.arrays[name], theirs.arrays[name]) for name in theirs.arrays)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Result]:
    """The uninterrupted training of each kind."""
    results: dict[str, Result] = {}

    def result(kind: str = "ppo") -> Result:
        if kind not in results:
            results[kind] = train(config(kind), tmp_path_factory.mktemp(kind), command="osl train tiny")
        return results[kind]

    return result


@pytest.mark.parametrize("kind", KINDS)
def test_every_algorithm_learns_and_ships(kind: str, finished: Callable[[str], Result]) -> None:
    result = finished(kind)
    assert result.steps == 144
    assert {entry.name for entry in result.folder.iterdir()} == {
        "config.yaml", "last", "best", "evaluations.csv", "tensorboard"
    }  # fmt: skip
    assert (result.folder / "evaluations.csv").read_text().count("\n") == 3
    header = Checkpoint.load(result.checkpoint).header
    assert header.training["command"] == "osl train tiny"
    assert header.training["steps"] == result.best.steps == header.scores["held_out"]["steps"]
    assert make_config(header.training["config"]) == config(kind)
    shipped = make_policy("checkpoint", path=result.checkpoint)
    records = evaluate(shipped, config(kind).evaluation.made(), range(50_000, 50_002), n_jobs=1)
    assert records.values("reward").mean() == result.best.reward  # what was scored is what ships


@pytest.mark.parametrize("kind", KINDS)
def test_a_resumed_training_is_the_uninterrupted_one(
    kind: str, finished: Callable[[str], Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Milestones.save

    def save_and_die(self: Milestones) -> None:
        save(self)
        if self.model.num_timesteps == 96:
            raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(Milestones, "save", save_and_die)
        with pytest.raises(KilledError):
            train(config(kind), tmp_path)
    torch.rand(3)  # what other code has drawn meanwhile
    resumed = train(config(kind), tmp_path, resume=True)
    assert_same_state(finished(kind).folder, tmp_path)
    assert resumed.best == finished(kind).best


def test_saving_and_scoring_leave_no_trace(finished: Callable[[str], Result], tmp_path: Path) -> None:
    train(config(checkpoints={"every": 12}, evaluation=content()["evaluation"] | {"every": 24}), tmp_path)
    one, other = state(finished("ppo").folder), state(tmp_path)
    assert all(one._arrays[name].tobytes() == other._arrays[name].tobytes() for name in one._arrays)


def test_a_kill_while_writing_leaves_the_save_before(
    finished: Callable[[str], Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, saves = resume_state.save_file, []

    def write_half_and_die(arrays: Any, path: Path, metadata: Any) -> None:
        write(arrays, path, metadata=metadata)
        saves.append(path)
        if len(saves) == 3:  # steps 0, 48, 96
            os.truncate(path, path.stat().st_size // 2)
            os.kill(os.getpid(), signal.SIGKILL)

    child = os.fork()
    if child == 0:
        monkeypatch.setattr(resume_state, "save_file", write_half_and_die)
        train(config(), tmp_path)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert len(list((tmp_path / "last").iterdir())) == 2  # the half-written file is still there
    assert state(tmp_path).notes["saved_at"] == 48
    train(config(), tmp_path, resume=True)
    assert_same_state(finished("ppo").folder, tmp_path)
    assert [entry.name for entry in (tmp_path / "last").iterdir()] == ["state.safetensors"]


def press_ctrl_c(monkeypatch: pytest.MonkeyPatch, at_step: int, times: int = 1) -> None:
    on_step = Milestones._on_step

    def step(self: Milestones) -> bool:
        if self.num_timesteps == at_step:
            for _ in range(times):
                os.kill(os.getpid(), signal.SIGINT)
        return on_step(self)

    monkeypatch.setattr(Milestones, "_on_step", step)


def test_ctrl_c_saves_and_says_how_to_go_on(
    finished: Callable[[str], Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    file, folder = config_file(tmp_path), tmp_path / "run"
    words = ["train", str(file), "--folder", str(folder)]
    before = signal.getsignal(signal.SIGINT)
    with monkeypatch.context() as patch:
        press_ctrl_c(patch, at_step=54)
        assert main(words) == 130
    assert signal.getsignal(signal.SIGINT) is before
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("osl: stopped after 72 of 144 steps, all of them kept in")
    assert last.endswith("the same command with --resume goes on from there")
    assert main([*words, "--resume", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["checkpoint"] == str(folder / "best")
    assert said["best"]["steps"] == finished("ppo").best.steps
    assert_same_state(finished("ppo").folder, folder)


def test_a_second_ctrl_c_stops_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    press_ctrl_c(monkeypatch, at_step=54, times=2)
    with pytest.raises(TrainingStopped, match=r"stopped after 54 of 144 steps, those up to 48 kept in"):
        train(config(), tmp_path)
    assert state(tmp_path).notes["saved_at"] == 48


def test_ctrl_c_while_scoring_keeps_the_steps(
    finished: Callable[[str], Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> Score:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(callbacks, "score", stop)
        with pytest.raises(TrainingStopped, match="72 of 144 steps, all"):
            train(config(), tmp_path)
    train(config(), tmp_path, resume=True)
    assert_same_state(finished("ppo").folder, tmp_path)


def test_the_best_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    times = {24: 500.0, 48: 300.0, 72: 300.0, 96: 700.0}

    def score(checkpoint: Checkpoint, *_: object) -> Score:
        steps = int(checkpoint.header.training["steps"])
        return Score(steps, 2, 0.5, times[steps], 900.0, 0.0, 1.0, -5.0)

    monkeypatch.setattr(callbacks, "score", score)
    every = content()["evaluation"] | {"every": 24}
    result = train(config(steps=96, evaluation=every), tmp_path)
    assert result.best.steps == Checkpoint.load(result.checkpoint).header.training["steps"] == 48
    assert result.last.steps == 96


def test_weights_that_are_not_finite_stop_the_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    learn = PPO.train

    def diverge(self: PPO) -> None:
        learn(self)
        if self.num_timesteps == 72:
            with torch.no_grad():
                next(self.policy.parameters()).fill_(torch.nan)

    monkeypatch.setattr(PPO, "train", diverge)
    with pytest.raises(InputError, match=r"not finite any more after .* steps.*learning_rate") as caught:
        train(config(), tmp_path)
    assert "\n" not in str(caught.value)
    weights = state(tmp_path)._arrays
    assert all(np.isfinite(array).all() for array in weights.values() if array.dtype == np.float32)


def test_a_finished_training_can_be_lengthened(finished: Callable[[str], Result], tmp_path: Path) -> None:
    shutil.copytree(finished("ppo").folder, tmp_path / "run")
    again = train(config(), tmp_path / "run", resume=True)
    assert (again.steps, again.best) == (144, finished("ppo").best)
    assert train(config(steps=168), tmp_path / "run", resume=True).steps == 168


def test_folders_are_not_mixed_up(finished: Callable[[str], Result], tmp_path: Path) -> None:
    folder = finished("ppo").folder
    with pytest.raises(InputError, match="holds a training already: --resume"):
        train(config(), folder)
    with pytest.raises(InputError, match="holds no training to resume"):
        train(config(), tmp_path, resume=True)
    with pytest.raises(InputError, match=r"was trained with seed = 0, not 1; only steps"):
        train(config(seed=1), folder, resume=True)
    with pytest.raises(InputError, match=r"network.layers = \[8\], not \[9\]"):
        train(config(network={"kind": "mlp", "layers": [9]}), folder, resume=True)


def test_a_truncated_save_is_refused_in_one_line(finished: Callable[[str], Result], tmp_path: Path) -> None:
    shutil.copytree(finished("ppo").folder, tmp_path / "run")
    path = tmp_path / "run" / "last" / "state.safetensors"
    os.truncate(path, 1000)
    with pytest.raises(InputError, match="is truncated, or no saved training") as caught:
        train(config(), tmp_path / "run", resume=True)
    assert "\n" not in str(caught.value)


def test_seeds_give_other_weights(finished: Callable[[str], Result], tmp_path: Path) -> None:
    train(config(seed=1), tmp_path)
    ours, theirs = (Checkpoint.load(folder / "best").arrays for folder in (tmp_path, finished("ppo").folder))
    assert any(not np.array_equal(ours[name], theirs[name]) for name in theirs)


def test_the_curriculum_goes_with_the_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told, teams, begin = [], [], Milestones._on_rollout_start

    def note(self: Milestones) -> None:
        begin(self)
        env: Any = self.model.env
        told.append((self.num_timesteps, env._redraw[0]))
        teams.append(tuple(slot.team.n_uavs for slot in env.get_attr("scenario", [0, 2, 4])))

    monkeypatch.setattr(Milestones, "_on_rollout_start", note)
    result = train(config("ppo-randomised", steps=192), tmp_path)
    assert told == [(24 * k, k / 8) for k in range(8)]
    assert set(teams[:4]) == {(1, 1, 1)}
    assert 2 in teams[-1]
    last = state(result.folder)
    drawn = decode(last._content["scenarios"], last._arrays)["scenarios"]
    places = [scenario["team"]["region"][1] for scenario in drawn]
    assert [60.0, 60.0, 30.0] not in places  # those that were drawn early have all been replaced
    assert Checkpoint.load(result.checkpoint).header.max_uavs == 2
