"""What every registered policy must do, whatever its algorithm."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from checkpoints import random_checkpoint, write_sb3
from worlds import small

from baselines import Briefing, Policy, make_policy, policy_names
from osl_env import InputError, Scenario, World
from osl_env.actions import HOP_DIRECTIONS, Action, Hop, Hover, Setpoint, Velocity, Waypoint
from osl_env.parameters import FloatArray

NAMES = policy_names()

# no smell reaches anybody, but false counts do: readings are the same wherever the source hides
DECOY: dict[str, Any] = {
    "plume.source_strength": 1e-15,
    "advertised_plume": {"source_strength": 2.5},
    "gas_sensor.false_positive_rate": 0.3,
}
WORLDS: dict[str, dict[str, Any]] = {
    "alone": {"team.n_uavs": 1},
    "team": {},
    "no wind": {"wind.velocity": (0.0, 0.0, 0.0)},
    "radio off": {"radio.radius": 0.0},
    "short range": {"radio.radius": 8.0},
    "late and lossy": {"radio.latency": 5.0, "radio.loss": 0.3},
    "event clock": {"clock": "event"},
    "bad sensors": {"gas_sensor.false_positive_rate": 0.3, "gas_sensor.miss_probability": 0.4, "anemometer.noise": 0.4},
    "wrong briefing": {"advertised_plume": {"source_strength": 0.3, "diffusivity": 4.0}},
    "random": {"sources.region": [[0, 0, 0], [20, 20, 10]], "wind.random_direction": True},
    "flat corner": {"arena.size": (20.0, 20.0, 1.0), "sources.positions": [(0.0, 20.0, 1.0)],
                    "team.starts": [(20.0, 0.0, 0.0), (0.0, 0.0, 1.0), (20.0, 20.0, 0.5)]},
}  # fmt: skip


Maker = Callable[..., Policy]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Maker:
    """`make_policy`, with a small model of its own for each policy that flies a user's."""
    folder = tmp_path_factory.mktemp("models")

    def made(name: str, **parameters: Any) -> Policy:
        if name == "checkpoint":
            parameters = {"path": folder / "random"} | parameters
            if not (folder / "random").exists():
                random_checkpoint(small(), "lstm").write(folder / "random")
        if name == "sb3":
            pytest.importorskip("sb3_contrib")
            parameters = {"path": folder / "model.zip"} | parameters
            if not (folder / "model.zip").exists():
                write_sb3(folder / "model.zip", small())
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", ".*unpickles")
            return make_policy(name, **parameters)

    return made


@dataclass
class Flight:
    """What a team did in one episode."""

    world: World
    team: list[Policy]
    actions: list[str] = field(default_factory=list)
    payloads: list[list[bytes | None]] = field(default_factory=list)
    declared: list[FloatArray] = field(default_factory=list)


def scenario(policy: Policy, **changes: Any) -> Scenario:
    if policy.vehicle_commands[0] == "leg":
        return small(**{"action": "waypoint"} | changes)
    return small(**{"vehicle": {"kind": "point_mass"}, "action": policy.vehicle_commands[0]} | changes)


def fly(policy: Policy, task: Scenario, seed: int = 1, decisions: int = 1000) -> Flight:
    """One episode with a copy of `policy` for every UAV, every action checked."""
    world = World(task, 1)
    world.reset([seed])
    team = [copy.deepcopy(policy) for _ in range(world.n_uavs)]
    for uav, pilot in enumerate(team):
        pilot.reset(Briefing.of(task, uav, seed, world.motion["position"][0, uav]))
    flight = Flight(world, team)
    for _ in range(decisions):
        if not world.running[0]:
            break
        deciding = np.flatnonzero(world.motion["active"][0] & world.motion["ready"][0]).tolist()
        seen = {uav: world.observation(0, uav) for uav in deciding}
        payloads: list[bytes | None] = [None] * world.n_uavs
        for uav in deciding:
            payloads[uav] = team[uav].broadcast(seen[uav])
            assert payloads[uav] is None or isinstance(payloads[uav], bytes)
        inboxes = world.exchange([payloads])
        targets, samples = world.motion["position"].copy(), np.ones((1, world.n_uavs), np.int64)
        declarations = np.full((1, world.n_uavs, 3), np.nan)
        for uav in deciding:
            action = team[uav].act(seen[uav], inboxes[0][uav])
            targets[0, uav], samples[0, uav] = command(action, targets[0, uav], task)
            check_declaration(team[uav], declarations[0, uav], task)
            check_belief(team[uav])
            assert np.isfinite(team[uav].computed_bits)
            assert team[uav].computed_bits >= 0
            flight.actions.append(f"{uav} {targets[0, uav].tolist()} {samples[0, uav]}")
        flight.payloads.append(payloads)
        flight.declared += [place for place in declarations[0] if not np.isnan(place[0])]
        if task.action == "velocity":
            world.step_velocities(targets, declarations)
        elif task.action == "setpoint":
            world.step_setpoints(targets, declarations)
        else:
            world.step_waypoints(targets, samples, declarations)
    return flight


def command(action: Action, position: FloatArray, task: Scenario) -> tuple[FloatArray, int]:
    """Where `action` goes (or its velocity), and with how many samples; fails if it is not a valid one."""
    area, vehicle = np.array(task.arena.size), task.vehicle
    match action:
        case Velocity(velocity):
            assert task.action == "velocity"
            assert np.shape(velocity) == (3,)
            assert np.all(np.isfinite(velocity))
            return np.asarray(velocity, dtype=np.float64), 1
        case Setpoint(place):
            assert task.action == "setpoint"
            assert np.shape(place) == (3,)
            assert np.all(np.isfinite(place))
            return np.asarray(place, dtype=np.float64), 1
        case Hop(direction, length):
            assert 0 <= direction < 26
            assert 1 <= length <= vehicle.hop_lengths
            target = position + length * vehicle.step_length * HOP_DIRECTIONS[direction]
            samples = 1
        case Hover(samples):
            target = position
        case Waypoint(target, samples):
            assert np.shape(target) == (3,)
    assert np.all(np.isfinite(target))
    assert np.all((target >= -1e-9) & (target <= area + 1e-9)), f"{action} leaves the area"
    assert 1 <= samples <= vehicle.max_samples
    return np.asarray(target, dtype=np.float64), int(samples)


def check_declaration(pilot: Policy, out: FloatArray, task: Scenario) -> None:
    declared = pilot.declaration()
    if declared is None:
        return
    assert np.shape(declared) == (3,)
    assert np.all(np.isfinite(declared))
    assert np.all((declared >= -1e-9) & (declared <= np.array(task.arena.size) + 1e-9))
    out[:] = declared


def check_belief(pilot: Policy) -> None:
    belief = pilot.belief()
    if belief is None:
        return
    assert belief.mean.shape == (3,)
    assert belief.covariance.shape == (3, 3)
    assert np.all(np.isfinite(belief.mean))
    assert np.allclose(belief.covariance, belief.covariance.T)
    assert np.linalg.eigvalsh(belief.covariance).min() >= -1e-9
    if belief.particles is not None and belief.weights is not None:
        assert belief.particles.shape == (len(belief.weights), 3)
        assert belief.weights.min() >= 0
        assert belief.weights.sum() == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("name", NAMES)
def test_policies_fly_every_kind_of_world(make: Maker, name: str, world: str) -> None:
    policy = make(name)
    flight = fly(policy, scenario(policy, **{"ending.time_limit": 30.0} | WORLDS[world]))
    assert flight.actions
    assert not flight.world.running[0]


@pytest.mark.parametrize("name", NAMES)
def test_policies_are_deterministic_and_forget_with_a_reset(make: Maker, name: str) -> None:
    policy = make(name)
    task = scenario(policy, **{"ending.time_limit": 60.0})
    first, again = fly(policy, task, 5), fly(policy, task, 5)
    assert first.actions == again.actions
    assert first.payloads == again.payloads
    used = first.team[0]  # has flown an episode: a reset must bring it back to where it began
    assert fly(used, task, 5).actions == first.actions


@pytest.mark.parametrize("name", NAMES)
def test_policies_do_not_know_where_the_source_hides(make: Maker, name: str) -> None:
    policy = make(name)
    flights = []
    for place in ((18.0, 2.0, 1.0), (3.0, 17.5, 9.0)):
        # a declaration is judged by the truth: the success radius makes both right, so that both end alike
        task = scenario(policy, **DECOY, **{"sources.positions": [place], "ending.success_radius": 50.0})
        flights.append(fly(policy, task, 3))
    assert flights[0].actions == flights[1].actions
    assert flights[0].payloads == flights[1].payloads


@pytest.mark.parametrize("name", NAMES)
def test_copies_are_independent(make: Maker, name: str) -> None:
    policy = make(name)
    task = scenario(policy, **{"team.n_uavs": 1, "ending.time_limit": 30.0})
    alone = fly(policy, task, 2).actions
    pilot = fly(policy, task, 9, decisions=4).team[0]
    twin = copy.deepcopy(pilot)
    assert fly(twin, task, 2).actions == alone
    assert fly(pilot, task, 2).actions == alone


@pytest.mark.parametrize("name", NAMES)
def test_policies_do_not_write_into_what_they_are_given(make: Maker, name: str) -> None:
    policy = make(name)
    task = scenario(policy)
    world = World(task, 1)
    world.reset([1])
    briefing = Briefing.of(task, 0, 1, world.motion["position"][0, 0])
    start, area = briefing.start.copy(), briefing.area.copy()
    policy.reset(briefing)
    rows = world.physical.tobytes()
    policy.broadcast(world.observation(0, 0))
    inbox = world.exchange([[None] * 3])[0][0]
    before = [(message.position.tolist(), message.payload) for message in inbox]
    policy.act(world.observation(0, 0), inbox)
    assert world.physical.tobytes() == rows
    assert [(message.position.tolist(), message.payload) for message in inbox] == before
    assert np.array_equal(briefing.start, start)
    assert np.array_equal(briefing.area, area)


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_checked_in_one_line(make: Maker, name: str) -> None:
    policy = make(name)
    assert policy.name == name
    assert policy.summary
    with pytest.raises(InputError) as caught:
        make(name, no_such_parameter=1)
    assert str(caught.value).startswith(f"policy {name}: unknown key 'no_such_parameter': allowed are ")
    assert all((entry.alias or key) in str(caught.value) for key, entry in type(policy).model_fields.items())
    assert "\n" not in str(caught.value)
    for key, entry in type(policy).model_fields.items():
        if isinstance(entry.default, float):
            with pytest.raises(InputError, match=key) as caught:
                make(name, **{key: float("nan")})
            assert "\n" not in str(caught.value)


def test_unknown_policies_are_refused_with_a_hint() -> None:
    with pytest.raises(InputError, match="did you mean 'muc-osl'"):
        make_policy("muc-ols")
