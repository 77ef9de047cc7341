"""Policy `sb3`: a user's own zip is recognised, flown as SB3 would, and refused in one line where it does not fit."""

from __future__ import annotations

import copy
import pickle
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkpoints import write_sb3
from worlds import begun, flying, small

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import stable_baselines3
from torch import nn

from baselines import Briefing, Policy, policy
from baselines.features import SoloFeatures, make_spec
from baselines.learned.network import Network
from osl_env import InputError, Scenario
from osl_env.actions import Hop, Hover
from training import learned_policy
from training.flight import run_batch
from training.learned_policy import Sb3Policy, TorchNetwork

TASKS = {"PPO": small(), "RecurrentPPO": small(), "DQN": small(), "SAC": flying(), "way": small(action="waypoint")}
FOREIGN = {"policy_kwargs": {"activation_fn": nn.ELU}}  # no export: flown by torch
pytestmark = pytest.mark.filterwarnings("ignore:.*unpickles")


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> None:
    """`sb3` by name, whether the installed distribution has the entry point or not."""
    monkeypatch.setitem(policy._REGISTRY, "sb3", Sb3Policy)
    learned_policy._model.cache_clear()


def made(folder: Path, algorithm: str = "PPO", task: Scenario | None = None, **keywords: Any) -> Sb3Policy:
    path = write_sb3(folder / "model.zip", task or TASKS[algorithm], algorithm, **keywords)
    flown = policy.make_policy("sb3", path=path)
    assert isinstance(flown, Sb3Policy)
    return flown


def network_of(flown: Sb3Policy) -> Any:
    return flown._pilot._brain.network  # type: ignore[attr-defined]


@pytest.mark.parametrize("keywords", [{}, FOREIGN], ids=["numpy", "torch"])
@pytest.mark.parametrize("algorithm", ["PPO", "RecurrentPPO", "DQN", "SAC"])
def test_the_algorithm_is_found_and_flown(algorithm: str, keywords: dict[str, Any], tmp_path: Path) -> None:
    flown, task = made(tmp_path, algorithm, **keywords), TASKS[algorithm].override(**{"ending.time_limit": 20.0})
    assert isinstance(network_of(flown), TorchNetwork if keywords else Network)
    assert flown.vehicle_commands == ("velocity" if algorithm == "SAC" else "leg",)
    together = run_batch(flown, task, [1, 2, 3])
    for seed, record in enumerate(together, start=1):
        (alone,) = run_batch(flown, task, [seed])
        assert repr(replace(alone, decision_seconds=0.0)) == repr(replace(record, decision_seconds=0.0))


@pytest.mark.parametrize("keywords", [{}, FOREIGN], ids=["numpy", "torch"])
@pytest.mark.parametrize("algorithm", ["PPO", "RecurrentPPO", "DQN"])
def test_actions_are_those_of_predict(algorithm: str, keywords: dict[str, Any], tmp_path: Path) -> None:
    flown, task = made(tmp_path, algorithm, **keywords), TASKS[algorithm].override(**{"team.n_uavs": 1})
    model = learned_policy._model(flown.path, algorithm, flown.sha256)  # type: ignore[arg-type]
    world, memory, start = begun(task), None, np.ones(1, np.bool_)
    briefing = Briefing.of(task, 0, 1, world.motion["position"][0, 0])
    flown.reset(briefing)
    features = SoloFeatures(make_spec([{"kind": "raw", "neighbours": 0}]), briefing)
    for step in range(8):
        seen = world.observation(0, 0)
        action, memory = model.predict(features.update(seen, [])[None], memory, start, deterministic=True)
        start = np.zeros(1, np.bool_)
        expected = Hover(1) if action[0] >= 52 else Hop(action[0] // 2, action[0] % 2 + 1)
        given = flown.act(seen, [])
        if isinstance(given, Hop):  # it may have been shortened at the boundary
            assert isinstance(expected, Hop)
            assert given.direction == expected.direction
        world.step_hops(np.array([[(7 * step) % 52]]))


def test_waypoint_models_are_told_by_their_action_space(tmp_path: Path) -> None:
    flown = made(tmp_path, task=TASKS["way"])
    assert flown.vehicle_commands == ("leg",)
    assert run_batch(flown, small(), [1])


def test_setpoint_models_are_told_by_their_parameter(tmp_path: Path) -> None:
    path = write_sb3(tmp_path / "model.zip", flying(action="setpoint"), "SAC")
    assert policy.make_policy("sb3", path=path).vehicle_commands == ("velocity",)
    steering = policy.make_policy("sb3", path=path, agent="setpoint")
    assert steering.vehicle_commands == ("setpoint",)
    assert run_batch(steering, TASKS["SAC"].override(**{"ending.time_limit": 20.0}), [1])
    assert "agent = 'hop': " in refusal(path=path, agent="hop")
    assert "which are those of velocity or setpoint" in refusal(path=path, agent="waypoint")
    assert "agent = 'course'" in refusal(path=path, agent="course")


def test_stochastic_flights_follow_the_seed(tmp_path: Path) -> None:
    for keywords in ({}, FOREIGN):
        path = made(tmp_path, **keywords).path
        drawn = policy.make_policy("sb3", path=path, stochastic=True)
        first, second = run_batch(drawn, small(), [4]), run_batch(drawn, small(), [4])
        assert repr(replace(first[0], decision_seconds=0.0)) == repr(replace(second[0], decision_seconds=0.0))
        greedy = run_batch(policy.make_policy("sb3", path=path), small(), [4])
        assert greedy[0].path != first[0].path


@pytest.mark.parametrize("keywords", [{}, FOREIGN], ids=["numpy", "torch"])
def test_copies_share_the_model_and_survive_another_process(keywords: dict[str, Any], tmp_path: Path) -> None:
    flown = made(tmp_path, "RecurrentPPO", **keywords)
    assert network_of(copy.deepcopy(flown)) is network_of(flown)
    sent: Policy = pickle.loads(pickle.dumps(flown))
    here, there = run_batch(flown, small(), [1]), run_batch(sent, small(), [1])
    assert repr(replace(here[0], decision_seconds=0.0)) == repr(replace(there[0], decision_seconds=0.0))


def test_features_of_the_training_may_be_given(tmp_path: Path) -> None:
    path = made(tmp_path).path
    policy.make_policy("sb3", path=path, features=[{"kind": "raw", "neighbours": 0}])
    with pytest.raises(InputError, match="the features have 42"):
        policy.make_policy("sb3", path=path, features=[{"kind": "raw", "neighbours": 1}])


def test_it_says_plainly_that_it_unpickles(tmp_path: Path) -> None:
    path = write_sb3(tmp_path / "model.zip", small())
    with pytest.warns(UserWarning, match="unpickles it, which can run any code"):
        policy.make_policy("sb3", path=path)


def refusal(**parameters: Any) -> str:
    with pytest.raises(InputError) as caught:
        policy.make_policy("sb3", **parameters)
    text = str(caught.value)
    assert text.startswith("policy sb3: ")
    assert "\n" not in text
    return text


def test_files_that_are_no_models_are_refused_in_one_line(tmp_path: Path) -> None:
    assert "nowhere.zip: cannot be read (No such file" in refusal(path=tmp_path / "nowhere.zip")
    (tmp_path / "text.zip").write_text("hello")
    assert "is not a zip that Stable-Baselines3 has saved" in refusal(path=tmp_path / "text.zip")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("readme", "hello")
    assert "is not a zip that Stable-Baselines3 has saved" in refusal(path=tmp_path / "other.zip")
    with zipfile.ZipFile(tmp_path / "data.zip", "w") as archive:
        archive.writestr("data", "{}")
    assert "its algorithm cannot be told" in refusal(path=tmp_path / "data.zip")
    assert "cannot be loaded as PPO" in refusal(path=tmp_path / "data.zip", algorithm="PPO")
    assert "'path' is missing" in refusal()
    path = write_sb3(tmp_path / "model.zip", small())
    cut = tmp_path / "cut.zip"
    cut.write_bytes(path.read_bytes()[:-200])
    assert "is not a zip that Stable-Baselines3 has saved" in refusal(path=cut)
    assert "algorithm = 'A3C'" in refusal(path=path, algorithm="A3C")


def test_other_spaces_are_refused_in_one_line(tmp_path: Path) -> None:
    import gymnasium

    for number, (name, message) in enumerate({"CartPole-v1": "actions Discrete(2)", "Pendulum-v1": "a Box"}.items()):
        path = tmp_path / f"{number}.zip"
        stable_baselines3.PPO("MlpPolicy", gymnasium.make(name), device="cpu").save(path)
        assert message in refusal(path=path)
    from osl_env.envs.single import TeamEnv

    task = small(action="velocity", **{"vehicle": {"kind": "point_mass"}, "team.n_uavs": 1})
    observed = TeamEnv(task)
    observed.observation_space = gymnasium.spaces.Box(-1.0, 1.0, (37,), np.float32)
    stable_baselines3.PPO("MlpPolicy", observed, device="cpu").save(tmp_path / "wide.zip")
    assert "not those of one UAV" in refusal(path=tmp_path / "wide.zip")


def test_other_hop_lengths_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="trained with hop_lengths = 2, the scenario has hop_lengths = 4"):
        run_batch(made(tmp_path), small(**{"vehicle.hop_lengths": 4}), [1])


def test_without_torch_there_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_sb3(tmp_path / "model.zip", small())
    real = learned_policy.importlib.import_module  # type: ignore[attr-defined]

    def missing(name: str, *rest: Any) -> Any:
        if name in ("stable_baselines3", "sb3_contrib"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *rest)

    monkeypatch.setattr(learned_policy.importlib, "import_module", missing)  # type: ignore[attr-defined]
    assert "needs stable_baselines3, which is not installed: pip install 'osl-env[train]'" in refusal(path=path)


def test_the_policy_can_be_listed_without_torch() -> None:
    import subprocess
    import sys

    code = "import sys, training.learned_policy; print(any(m.split('.')[0] == 'torch' for m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
