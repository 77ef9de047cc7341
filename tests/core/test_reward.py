"""The reward's terms one by one, and the law of potential-based shaping."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import advance, begun, flying, hover, random_commands, small

from osl_env import World
from osl_env.parameters import FloatArray

NOTHING = {"time": 0.0, "success": 0.0, "false_declaration": 0.0, "energy": 0.0, "detection": 0.0, "shaping": 0.0}
MODES: list[dict[str, Any]] = [
    {},
    {"clock": "event"},
    {"action": "waypoint"},
    {"vehicle": {"kind": "point_mass"}, "action": "velocity"},
    {"vehicle": {"kind": "point_mass"}, "action": "setpoint"},
]


def only(changes: dict[str, Any] | None = None, **weights: float) -> World:
    return begun(small(reward=NOTHING | weights, **changes or {}), [1, 2, 3])


def distance(world: World) -> FloatArray:
    gaps = world.motion["position"][:, :, None] - world.source_position[:, None]
    nearest: FloatArray = np.linalg.norm(gaps, axis=-1).min(axis=-1)
    return nearest


@pytest.mark.parametrize("changes", MODES)
def test_time_term_is_paid_for_each_second_of_search(changes: dict[str, Any]) -> None:
    world, rng = only(changes, time=-0.5), np.random.default_rng(0)
    while world.running.any():
        before = world.ledger["search_time"].copy()
        advance(world, random_commands(world, rng))
        np.testing.assert_allclose(world.rewards, -0.5 * (world.ledger["search_time"] - before), atol=1e-12)
    first = 0.0 if world.scenario.in_periods else 1.0  # the sample before the first decision is free
    np.testing.assert_allclose(world.ledger["total_reward"], -0.5 * (world.ledger["search_time"] - first), rtol=1e-9)


@pytest.mark.parametrize("changes", [*MODES, {"energy.capacity": 9000.0}])
def test_energy_term_is_paid_for_each_kilojoule(changes: dict[str, Any]) -> None:
    world, rng = only(changes, energy=-2.0), np.random.default_rng(0)
    before = world.ledger["spent"].copy()
    start = before.copy()
    while world.running.any():
        advance(world, random_commands(world, rng))
        paid = world.rewards != 0
        np.testing.assert_allclose(world.rewards[paid], -2e-3 * (world.ledger["spent"] - before)[paid], atol=1e-6)
        before = world.ledger["spent"].copy()
    # the first radio frame, sent within the reset, is paid for with the first step: 1e-7 at most
    np.testing.assert_allclose(world.ledger["total_reward"], -2e-3 * (world.ledger["spent"] - start), atol=1e-6)


@pytest.mark.parametrize("changes", MODES)
def test_detection_term_is_paid_once_for_each_sample_with_a_hit(changes: dict[str, Any]) -> None:
    world, rng = only(changes, detection=3.0), np.random.default_rng(0)
    while world.running.any():
        before = world.senses["detections"].copy()
        advance(world, random_commands(world, rng))
        assert world.rewards.tolist() == (3.0 * (world.senses["detections"] - before)).tolist()


def test_declaring_does_not_pay_the_last_detection_again() -> None:
    world = only({"gas_sensor.false_positive_rate": 20.0}, detection=3.0)
    world.step_hops(hover(world))
    assert world.rewards[0].tolist() == [3.0] * 3
    world.step_hops(hover(world, declare=0))
    assert not world.rewards[0].any()


def test_the_team_gets_success_and_false_declaration_together() -> None:
    at_source = {"team.starts": [(12.0, 13.0, 5.0), (1.0, 1.0, 1.0), (19.0, 1.0, 1.0)]}
    world = only(at_source, success=20.0, false_declaration=-7.0)
    world.step_hops(hover(world))
    assert not world.rewards.any()
    actions = hover(world)
    actions[0, 0] += 1  # right, in world 0
    actions[1, 1] += 1  # wrong, in world 1; world 2 goes on
    world.step_hops(actions)
    assert world.rewards.tolist() == [[20.0] * 3, [-7.0] * 3, [0.0] * 3]
    assert world.team["reward"].tolist() == [20.0, -7.0, 0.0]
    world.step_hops(hover(world))
    assert not world.rewards.any()  # paid once


def test_terms_add_up() -> None:
    weights = {"time": -0.1, "energy": -0.5, "detection": 0.7, "shaping": 0.3, "discount": 0.9}
    together, rng = only(**weights), np.random.default_rng(1)
    apart = [only(**{name: weight, "discount": 0.9}) for name, weight in weights.items() if name != "discount"]
    for _ in range(8):
        commands = random_commands(together, rng)
        for world in (together, *apart):
            advance(world, commands)
        np.testing.assert_allclose(together.rewards, sum(world.rewards for world in apart), atol=1e-9)
        np.testing.assert_allclose(together.team["reward"], together.rewards.mean(axis=1), atol=1e-12)


def test_shaping_is_the_discounted_difference_of_the_potential() -> None:
    world, rng = only(shaping=0.5, discount=0.9), np.random.default_rng(0)
    for _ in range(6):
        before = -0.5 * distance(world)
        advance(world, random_commands(world, rng))
        np.testing.assert_allclose(world.rewards, 0.9 * -0.5 * distance(world) - before, atol=1e-12)


@pytest.mark.parametrize(
    "changes", [*MODES, {"radio.radius": 5.0}, {"ending.success": "reach", "ending.success_radius": 0.1}]
)
def test_undiscounted_shaping_telescopes_over_a_truncated_episode(changes: dict[str, Any]) -> None:
    world, rng = only(changes, shaping=0.5, discount=1.0), np.random.default_rng(0)
    start, steps = distance(world), 0
    while world.running.any():
        advance(world, random_commands(world, rng))
        steps += 1
    assert world.motion["truncated"].all()
    np.testing.assert_allclose(world.ledger["total_reward"], 0.5 * (start - distance(world)), atol=1e-9)


@pytest.mark.parametrize("how", ["declare", "battery", "reach"])
def test_undiscounted_shaping_sums_to_minus_the_first_potential_at_termination(how: str) -> None:
    changes: dict[str, Any] = {"battery": {"energy.capacity": 9000.0}, "reach": {"ending.success": "reach"}}.get(
        how, {}
    )
    world = only(changes | {"ending.time_limit": 5000.0}, shaping=0.5, discount=1.0)
    start, rng, steps = distance(world), np.random.default_rng(0), 0
    while world.running.any():
        commands = random_commands(world, rng)
        if how == "declare" and steps == 5:
            commands = (hover(world, declare=1),)
        advance(world, commands)
        steps += 1
    assert world.motion["terminated"].all()
    np.testing.assert_allclose(world.ledger["total_reward"], 0.5 * start, atol=1e-9)


def test_the_potential_is_the_distance_to_the_nearest_of_several_sources() -> None:
    world = only({"sources.positions": [(1.0, 1.0, 1.0), (19.0, 19.0, 9.0)]}, shaping=1.0, discount=1.0)
    start = distance(world)
    world.step_hops(np.full((3, 3), 3))
    np.testing.assert_allclose(world.rewards, start - distance(world), atol=1e-12)


def test_the_default_reward_is_minus_a_point_a_minute() -> None:
    world = begun(flying())
    for _ in range(10):
        world.step_velocities(np.zeros((1, 3, 3)))
    np.testing.assert_allclose(world.ledger["total_reward"], -10.0 / 60.0)
