"""Checkpoints fly as they were trained, one at a time or many at once, and refuse what they were not trained for."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checkpoints import random_checkpoint
from worlds import begun, flying, small

from baselines import Briefing, make_policy, policy_names
from baselines.learned.checkpoint import Checkpoint
from baselines.learned.network import Architecture, Network
from baselines.policy import Policy
from osl_env import InputError, Scenario, World
from osl_env.actions import Hop, Hover
from osl_env.envs.spaces import ActionTranslator
from osl_env.record import EpisodeRecord
from training.flight import fly, run_batch
from training.store import cell_key, parameters_of

FREE_COMPUTING = {"energy.switched_capacitance": 0.0}  # training does not charge for the network, flying does
TASKS: dict[str, Scenario] = {
    "hop": small(**FREE_COMPUTING),
    "waypoint": small(**FREE_COMPUTING, action="waypoint"),
    "velocity": flying(**FREE_COMPUTING),
    "setpoint": flying(**FREE_COMPUTING, action="setpoint"),
}
RAW_3 = [{"kind": "raw", "neighbours": 2}]  # of three UAVs: the environments' own vector


def policy_of(checkpoint: Checkpoint, folder: Path, **parameters: Any) -> Policy:
    return make_policy("checkpoint", path=checkpoint.write(folder / "random"), **parameters)


def content(record: EpisodeRecord) -> str:
    """Everything in `record` but the wall time, as text, in which NaN equals NaN."""
    return repr(replace(record, decision_seconds=0.0))


def trajectory(world: World) -> list[Any]:
    motion, ledger = world.motion, world.ledger
    return [motion["position"].copy(), ledger["spent"].copy(), ledger["search_time"].copy(), world.running.copy()]


@pytest.mark.parametrize("kind", ["mlp", "lstm", "team"])
@pytest.mark.parametrize("agent", TASKS)
def test_it_flies_as_in_the_environment_that_it_was_trained_in(agent: str, kind: str, tmp_path: Path) -> None:
    task, seeds = TASKS[agent], [3, 4]
    features = [{"kind": "raw"}] if kind == "team" else RAW_3
    checkpoint = random_checkpoint(task, kind, features)
    flown: list[list[Any]] = []
    fly(policy_of(checkpoint, tmp_path), task, seeds, watch=lambda world: flown.append(trajectory(world)))

    network = Network(Architecture.parse(checkpoint.header.architecture, "test"), checkpoint.arrays)
    world = begun(task, seeds)
    translator = ActionTranslator(world)
    state, trained = network.start(6), [trajectory(world)]
    while world.running.any():
        flat = world.layout.flat(world).reshape(6, -1)
        rows = np.zeros((6, checkpoint.header.observation.size), np.float32)
        rows[:, : flat.shape[1]] = flat
        actions, state = network.greedy(rows, state)
        translator.step(actions.reshape(translator.shape))
        trained.append(trajectory(world))
    assert len(trained) == len(flown) > 2
    for there, here in zip(trained, flown, strict=True):
        for first, second in zip(there, here, strict=True):
            np.testing.assert_allclose(first, second, atol=1e-5)


@pytest.mark.parametrize("stochastic", [False, True])
@pytest.mark.parametrize("kind", ["mlp", "lstm", "team"])
@pytest.mark.parametrize("agent", TASKS)
def test_an_episode_does_not_depend_on_its_batch(agent: str, kind: str, stochastic: bool, tmp_path: Path) -> None:
    policy = policy_of(random_checkpoint(TASKS[agent], kind, scale=0.5), tmp_path, stochastic=stochastic)
    together = run_batch(policy, TASKS[agent], range(5))
    for seed, record in enumerate(together):
        (alone,) = run_batch(policy, TASKS[agent], [seed])
        assert content(alone) == content(record)


@pytest.mark.parametrize("kind", ["lstm", "team"])
def test_deciding_together_is_deciding_one_by_one(kind: str, tmp_path: Path) -> None:
    task = TASKS["waypoint"]
    policy = policy_of(random_checkpoint(task, kind), tmp_path)
    world = begun(task, [1, 2])
    crews = [[copy.deepcopy(policy) for _ in range(6)] for _ in range(2)]
    for k in range(6):
        for crew in crews:
            crew[k].reset(Briefing.of(task, k % 3, k // 3 + 1, world.motion["position"][k // 3, k % 3]))
    seen = [world.observation(k // 3, k % 3) for k in range(6)]
    for _ in range(3):
        together = type(policy).act_batch(crews[0], seen, [[]] * 6)
        alone = [pilot.act(observation, []) for pilot, observation in zip(crews[1], seen, strict=True)]
        assert [str(action) for action in together] == [str(action) for action in alone]


def test_hops_are_shortened_at_the_boundary(tmp_path: Path) -> None:
    task = small(
        **{"arena.size": (20.0, 20.0, 10.0), "team.starts": [(1.0, 5.0, 5.0), (9.0, 5.0, 5.0), (0.0, 0.0, 0.0)]}
    )
    checkpoint = random_checkpoint(task)
    arrays = {name: np.zeros_like(array) for name, array in checkpoint.arrays.items()}
    west = 4 * 2 + 1  # direction (-1, 0, 0), two steps
    arrays["action.bias"][west] = 1.0
    policy, world = policy_of(replace(checkpoint, arrays=arrays), tmp_path), begun(task)
    actions = []
    for uav in range(3):
        policy.reset(Briefing.of(task, uav, 1, world.motion["position"][0, uav]))
        actions.append(policy.act(world.observation(0, uav), []))
    assert actions == [Hop(4, 1), Hop(4, 2), Hover(1)]


@pytest.mark.parametrize("agent", TASKS)
def test_it_declares_its_own_place(agent: str, tmp_path: Path) -> None:
    task = TASKS[agent]
    checkpoint = random_checkpoint(task)
    arrays = {name: np.zeros_like(array) for name, array in checkpoint.arrays.items()}
    policy, world = policy_of(replace(checkpoint, arrays=arrays), tmp_path / "silent"), begun(task)
    policy.reset(Briefing.of(task, 1, 1, world.motion["position"][0, 1]))
    assert policy.declaration() is None
    policy.act(world.observation(0, 1), [])
    assert policy.declaration() is None
    arrays["action.bias"][-1] = 1.0
    policy = policy_of(replace(checkpoint, arrays=arrays), tmp_path / "sure")
    policy.reset(Briefing.of(task, 1, 1, world.motion["position"][0, 1]))
    policy.act(world.observation(0, 1), [])
    assert np.array_equal(policy.declaration(), world.motion["position"][0, 1])  # type: ignore[arg-type]


def test_draws_follow_the_seed_and_differ_from_the_greedy_flight(tmp_path: Path) -> None:
    policy = policy_of(random_checkpoint(TASKS["hop"], scale=0.2), tmp_path, stochastic=True)
    first, second = run_batch(policy, TASKS["hop"], [1]), run_batch(policy, TASKS["hop"], [1])
    assert content(first[0]) == content(second[0])
    greedy = run_batch(policy_of(random_checkpoint(TASKS["hop"], scale=0.2), tmp_path), TASKS["hop"], [1])
    assert greedy[0].parameters != first[0].parameters
    assert greedy[0].energy != first[0].energy


def test_copies_share_the_weights_and_survive_another_process(tmp_path: Path) -> None:
    policy = policy_of(random_checkpoint(TASKS["hop"], "lstm"), tmp_path)
    twin = copy.deepcopy(policy)
    assert twin._pilot._brain is policy._pilot._brain  # type: ignore[attr-defined]
    sent = pickle.loads(pickle.dumps(policy))
    here, there = run_batch(policy, TASKS["hop"], [2]), run_batch(sent, TASKS["hop"], [2])
    assert content(here[0]) == content(there[0])


def test_computing_is_charged(tmp_path: Path) -> None:
    checkpoint = random_checkpoint(small())
    policy, world = policy_of(checkpoint, tmp_path), begun(small())
    policy.reset(Briefing.of(small(), 0, 1, world.motion["position"][0, 0]))
    policy.act(world.observation(0, 0), [])
    assert policy.computed_bits == 32 * sum(array.size for array in checkpoint.arrays.values())


def test_records_and_stores_tell_weights_apart(tmp_path: Path) -> None:
    policies = [policy_of(random_checkpoint(TASKS["hop"], seed=seed), tmp_path) for seed in (1, 2)]
    digests = [parameters_of(policy)["sha256"] for policy in policies]
    assert len(digests[0]) == 64
    assert digests[0] != digests[1]
    assert cell_key(TASKS["hop"], policies[0]) != cell_key(TASKS["hop"], policies[1])
    with pytest.raises(InputError, match="policy checkpoint: sha256"):
        make_policy("checkpoint", path=tmp_path / "random", sha256=digests[0])
    make_policy("checkpoint", path=tmp_path / "random", sha256=digests[1])


def other_hash(checkpoint: Checkpoint) -> Checkpoint:
    changed = checkpoint.header.observation.model_copy(update={"hash": "0123456789ab"})
    return replace(checkpoint, header=checkpoint.header.model_copy(update={"observation": changed}))


def without(name: str, checkpoint: Checkpoint) -> Checkpoint:
    return replace(checkpoint, arrays={key: array for key, array in checkpoint.arrays.items() if key != name})


def with_header(checkpoint: Checkpoint, **keys: Any) -> Checkpoint:
    return replace(checkpoint, header=checkpoint.header.model_copy(update=keys))


def test_what_does_not_fit_together_is_refused_in_one_line(tmp_path: Path) -> None:
    whole = random_checkpoint(TASKS["hop"])
    layers = whole.header.architecture
    bad = {
        "another definition of its observation": other_hash(whole),
        "array 'action.bias' is missing": without("action.bias", whole),
        "array 'surplus': the architecture has none": replace(
            whole, arrays={**whole.arrays, "surplus": np.ones(1, np.float32)}
        ),
        "has the shape": with_header(whole, architecture=layers | {"hidden": [17]}),
        "unknown key 'depth'": with_header(whole, architecture=layers | {"depth": 3}),
        "takes no lstm": with_header(whole, architecture=layers | {"lstm": {"size": 3}}),
        "needs the sizes": with_header(whole, architecture=layers | {"kind": "team"}),
        "needs 28 outputs": with_header(whole, action={"step_length": 1.0, "hop_lengths": 1}),
        "needs 5 outputs": with_header(whole, agent="waypoint", action={}),
        "action: unknown key 'hops'": with_header(whole, action={"hops": 1}),
    }
    for number, (message, checkpoint) in enumerate(bad.items()):
        with pytest.raises(InputError) as caught:
            policy_of(checkpoint, tmp_path / str(number))
        assert message in str(caught.value)
        assert str(caught.value).startswith("policy checkpoint: ")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"team.n_uavs": 9, "team.region": [[0, 0, 0], [20, 20, 10]]}, "teams of at most 8 UAVs, the scenario has 9"),
        ({"vehicle.hop_lengths": 3}, "trained with hop_lengths = 2, the scenario has hop_lengths = 3"),
        ({"vehicle.step_length": 0.5}, "trained with step_length = 1, the scenario has step_length = 0.5"),
    ],
)
def test_scenarios_that_it_was_not_trained_for_are_refused(
    changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    policy = policy_of(random_checkpoint(small()), tmp_path)
    with pytest.raises(InputError, match=message) as caught:
        run_batch(policy, small(**changes), [1])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("n_uavs", [1, 5, 8])
def test_one_policy_serves_teams_of_any_size(n_uavs: int, tmp_path: Path) -> None:
    task = small(**{"team.n_uavs": n_uavs, "team.region": [[0, 0, 0], [20, 20, 10]], "ending.time_limit": 20.0})
    policy = policy_of(random_checkpoint(small(), "team"), tmp_path)
    assert len(run_batch(policy, task, [1, 2])) == 2


def test_values_are_no_distribution_to_draw_from(tmp_path: Path) -> None:
    checkpoint = random_checkpoint(TASKS["hop"])
    checkpoint = with_header(checkpoint, architecture=checkpoint.header.architecture | {"head": "values"})
    policy_of(checkpoint, tmp_path)
    with pytest.raises(InputError, match="stochastic"):
        policy_of(checkpoint, tmp_path, stochastic=True)


def test_shipped_names_are_known_where_their_checkpoint_is() -> None:
    from baselines.learned.checkpoint import HEADER_FILE, shipped_folder
    from baselines.policy import SHIPPED_CHECKPOINTS

    assert set(policy_names()) & set(SHIPPED_CHECKPOINTS) == {
        name for name in SHIPPED_CHECKPOINTS if (shipped_folder(name) / HEADER_FILE).is_file()
    }
