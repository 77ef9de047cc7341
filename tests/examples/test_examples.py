"""Every script in `examples` runs, for a few steps; those whose library is not installed are skipped."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import osl_env
from baselines import make_policy, policy

FOLDER = Path(__file__).resolve().parents[2] / "examples"
LIBRARIES = {  # script -> what it needs beyond the package itself, and the extra that brings it
    "sb3_ppo": ("stable_baselines3", "train"),
    "recurrent_ppo": ("sb3_contrib", "train"),
    "as_checkpoint": ("torch", "train"),
    "torchrl_multi_agent": ("torchrl", "torchrl"),
    "rllib_multi_agent": ("ray.rllib", "rllib"),
}
# uneven ends: in the eighth decision some batteries are empty, and the others' decisions are used up
UNEVEN: dict[str, Any] = {"energy.capacity": 40e3, "ending.max_decisions": 8}


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports a script by its name, or skips the test."""

    def load(name: str) -> ModuleType:
        if name in LIBRARIES:
            library, extra = LIBRARIES[name]
            pytest.importorskip(library, reason=f"needs {library}: pip install 'osl-env[{extra}]'")
        return importlib.import_module(name)

    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    yield load
    policy._REGISTRY.pop("rally", None)  # a policy of an example is not kept


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: path.stem)
def test_each_script_says_how_it_is_run(path: Path) -> None:
    if path.stem == "as_checkpoint":
        return  # for the others to import
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert f"examples/{path.name} --steps" in str(ast.get_docstring(tree))
    (main,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == "main")
    assert "steps" in [argument.arg for argument in main.args.args]
    assert f"test_{path.stem}" in globals(), "has a test"


def test_gymnasium_loop(example: Any, capsys: pytest.CaptureFixture[str]) -> None:
    example("gymnasium_loop").main(steps=300)
    out = capsys.readouterr().out
    assert "episode over after 12" in out
    assert "1024 worlds of 3 UAVs" in out


def test_pettingzoo_loop(example: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    example("pettingzoo_loop").main(steps=5, picture=tmp_path / "episode.png")
    assert capsys.readouterr().out.count("return -") == 3
    assert (tmp_path / "episode.png").read_bytes().startswith(b"\x89PNG")


def test_own_policy(example: Any, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("own_policy")
    module.main(steps=2)
    assert capsys.readouterr().out.count("success rate") == 3


def test_sb3_ppo(example: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("sb3_ppo")
    with pytest.warns(UserWarning, match="unpickle"):
        module.main(steps=100, worlds=2, episodes=1, folder=tmp_path)
    assert capsys.readouterr().out.count("success rate") == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["solo.zip", "team.zip"]


def test_recurrent_ppo(example: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("recurrent_ppo")
    with pytest.warns(UserWarning, match="unpickle"):
        module.main(steps=100, worlds=2, episodes=1, path=tmp_path / "sub" / "recurrent.zip")
    assert "success rate" in capsys.readouterr().out


def test_a_foreign_network_flies_as_it_was_trained(example: Any, tmp_path: Path) -> None:
    """The checkpoint's actions are the network's most probable ones on the environment's own observations."""
    module = example("as_checkpoint")
    import torch

    scenario = osl_env.load_scenario("rate-60x60x30-random", **{"ending.max_decisions": 30})
    env = osl_env.parallel_env(scenario)
    torch.manual_seed(3)
    inputs, outputs = env.observation_space("uav_0").shape[0], int(env.action_space("uav_0").n)
    network = torch.nn.Sequential(torch.nn.Linear(inputs, 16), torch.nn.ReLU(), torch.nn.Linear(16, outputs))
    module.write_checkpoint(tmp_path / "net", [network[0], network[2]], "relu", scenario, "none")

    observations, infos = env.reset(seed=5)
    returns = np.zeros(3)
    while env.agents:
        with torch.no_grad():
            chosen = {agent: int(network(torch.tensor(observations[agent])).argmax()) for agent in env.agents}
        observations, rewards, _, _, infos = env.step(chosen)
        returns += [rewards.get(agent, 0.0) for agent in env.possible_agents]
    from training import evaluate

    (record,) = evaluate(make_policy("checkpoint", path=tmp_path / "net"), scenario, seeds=[5], n_jobs=1)
    assert record.mission_time == pytest.approx(max(info["clock"] for info in infos.values()))
    assert record.reward == pytest.approx(returns.mean(), rel=1e-5)


@pytest.mark.filterwarnings("ignore")  # TorchRL's own, about the version of PettingZoo
@pytest.mark.parametrize("centralised", [False, True])
def test_torchrl_multi_agent(
    centralised: bool, example: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    module = example("torchrl_multi_agent")
    module.main(steps=300, centralised=centralised, episodes=1, folder=tmp_path / "ippo")
    assert "success rate" in capsys.readouterr().out
    assert (tmp_path / "ippo" / "checkpoint.yaml").is_file()


@pytest.mark.filterwarnings("ignore")
def test_torchrl_sees_the_ends_of_each_uav(example: Any) -> None:
    example("torchrl_multi_agent")
    import torch
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper
    from torchrl.envs.utils import check_env_specs

    team = osl_env.parallel_env("rate-60x60x30-random", **UNEVEN, **{"ending.time_limit": 60.0})
    env = PettingZooWrapper(team, use_mask=True, done_on_any=False, return_state=True, seed=0)
    check_env_specs(env)
    batch = env.rollout(200, break_when_any_done=False)
    flying, last = batch["uav", "mask"], batch["next", "done"].squeeze(-1)
    assert last.sum() > 3
    assert not batch["next", "uav", "mask"][last].any()
    assert flying[1:][last[:-1]].all()  # and all fly again in the next episode
    done, reward = batch["next", "uav", "done"].squeeze(-1), batch["next", "uav", "reward"].squeeze(-1)
    assert done[~flying].all()
    assert (reward[~flying] == 0).all()
    assert torch.isfinite(batch["next", "uav", "observation"]).all()


def test_rllib_multi_agent(example: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    module = example("rllib_multi_agent")
    module.main(steps=300, episodes=1, folder=tmp_path / "ppo")
    assert "success rate" in capsys.readouterr().out
    assert (tmp_path / "ppo" / "checkpoint.yaml").is_file()


def test_rllib_wrapper_ends_what_is_over(example: Any) -> None:
    """Whatever flags the last step has: `__all__` says that it is over; batteries terminate, used-up time truncates."""
    module = example("rllib_multi_agent")
    env = module.Team(osl_env.parallel_env("rate-60x60x30-random", **UNEVEN))
    rng = np.random.default_rng(0)
    mixed = 0
    for seed in range(20):
        env.reset(seed=seed)
        over = False
        while not over:
            assert env.par_env.agents
            flying = list(env.par_env.agents)
            actions = {agent: int(rng.integers(53)) for agent in flying}
            _, _, terminated, truncated, _ = env.step(actions)
            over = terminated["__all__"] or truncated["__all__"]
        assert not env.par_env.agents
        assert not (terminated["__all__"] and truncated["__all__"])
        empty = [terminated[agent] for agent in flying]
        assert terminated["__all__"] == all(empty)
        mixed += any(empty) and not all(empty)
    assert mixed > 3
