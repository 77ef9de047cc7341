"""Configurations of trainings: what is shipped can be trained, and what is wrong is said in one line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch
from tiny_training import KINDS, config, config_file

from training.algorithms import learning_rate, make_model
from training.cli import main
from training.training_config import load_training, make_config, training_names

BAD: list[tuple[dict[str, Any], str]] = [
    ({"colour": 1}, "unknown key 'colour'"),
    ({"algorithm": {"kind": "ppo", "colour": 1}}, "unknown key 'algorithm.colour'"),
    ({"algorithm": {"kind": "ppo", "learning_rate": -1}}, "algorithm.learning_rate = -1"),
    ({"algorithm": {"kind": "pppo"}}, "algorithm.kind = 'pppo': did you mean 'ppo'"),
    ({"algorithm": 3}, "algorithm = 3: must be a mapping"),
    ({"environment": {"kind": "uav", "n_worlds": 3}}, "environment: must have either scenarios (at least one) or rand"),
    ({"environment": {"kind": "uav", "scenarios": ["rate-60x60x30"], "worlds": 3}}, "unknown key 'environment.worlds'"),
    ({"environment": {"kind": "uav", "scenarios": ["nowhere"]}}, "unknown scenario 'nowhere'"),
    ({"environment": {"kind": "uav", "scenarios": ["rate-60x60x30"], "features": [{"kind": "ra"}]}}, "ra"),
    (
        {"environment": {"kind": "uav", "scenarios": ["x"], "randomisation": {"scenario": "rate-60x60x30"}}},
        "environment: must have either scenarios",
    ),
    ({"environment": {"kind": "uav", "randomisation": {"scenario": "nowhere"}}}, "unknown scenario 'nowhere'"),
    ({"environment": {"kind": "uav", "randomisation": {"redraw": 2}}}, "environment.randomisation.scenario"),
    (
        {"environment": {"kind": "uav", "randomisation": {"scenario": "rate-60x60x30", "redraw": 2}}},
        "environment.randomisation.redraw = 2",
    ),
    ({"network": {"kind": "mlp", "layers": [8], "depth": 2}}, "unknown key 'network.depth'"),
    ({"network": {"kind": "lstm"}}, "network.kind = 'lstm': is trained by recurrent-ppo"),
    ({"network": {"kind": "team"}}, "environment.features must hold {kind: team} once"),
    ({"evaluation": {"scenario": "nowhere"}}, "evaluation: unknown scenario 'nowhere'"),
    ({"evaluation": {"scenario": "rate-60x60x30", "seeds": {"first": 99_950}}}, "the benchmarks'"),
    ({"steps": 0}, "steps = 0"),
    ({"name": "../elsewhere"}, "name = '../elsewhere'"),
    (
        {"algorithm": {"kind": "ppo", "n_steps": 4, "batch_size": 7}},
        "algorithm.batch_size = 7: must divide the rollout",
    ),
    ({"algorithm": {"kind": "sac"}}, "needs continuous actions"),
    ({"device": "cuda"}, "device = 'cuda'"),
]


@pytest.mark.parametrize(("changes", "complaint"), BAD, ids=[complaint for _, complaint in BAD])
def test_bad_input_is_one_line_and_exit_code_two(
    changes: dict[str, Any], complaint: str, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    file = config_file(tmp_path, **changes)
    assert main(["train", str(file), "--folder", str(tmp_path / "run")]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert complaint in err
    assert err.count("\n") == 1
    assert not [path for path in (tmp_path / "run").rglob("*") if path.is_file()]


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["train", "nothing.yaml"], "unknown training 'nothing.yaml'"),
        (["train"], "CONFIG"),
        (["train", "ppo-raw", "--steps", "0"], "--steps 0"),
        (["train", "ppo-raw", "--device", "tpu"], "--device"),
    ],
)
def test_bad_words(words: list[str], complaint: str, capsys: Any) -> None:
    assert main(words) == 2
    assert complaint in capsys.readouterr().err


def test_without_torch_there_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    assert main(["train", "ppo-raw"]) == 2
    assert capsys.readouterr().err == 'osl: osl train needs torch: pip install "osl-env[train]"\n'


def test_shipped_configurations_can_be_trained() -> None:
    assert {"ppo-raw", "rppo-raw", "ppo-belief", "ppo-generalist", "dqn-hops", "sac-velocity"} <= set(training_names())
    for name in training_names():
        shipped = load_training(name)
        assert shipped.name == name
        env = shipped.environment.make(shipped.first_episode_seed)
        assert make_model(shipped, env).num_timesteps == 0
        env.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_dump_is_a_configuration(kind: str) -> None:
    assert make_config(config(kind).dump()) == config(kind)


def test_the_learning_rate_falls_in_proportion_to_the_steps() -> None:
    schedule = learning_rate(config().algorithm)
    assert callable(schedule)
    assert [schedule(remaining) for remaining in (1.0, 0.5, 0.0, -0.1)] == [1e-2, 5e-3, 0.0, 0.0]


def test_training_episodes_are_nobody_elses() -> None:
    made = config(seed=7)
    env = made.environment.make(made.first_episode_seed)
    model = make_model(made, env)
    assert model.env is env
    env.reset()
    seeds = env.get_attr("episode_seed")
    assert min(seeds) >= 2**40
    assert len(set(seeds)) == 3
