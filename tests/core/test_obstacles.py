"""Obstacles in the world: nothing is ever inside one, and what is flown is what is paid for, masked and counted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from osl_env.arena import Arena
from osl_env.envs.spaces import ActionTranslator
from osl_env.errors import InputError
from osl_env.fields import Field, save_field
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import ENERGY_KINDS, FLYING, HOVERING, TURNING
from osl_env.world import World

OBSTACLES = [
    {"kind": "box", "low": [12.0, 10.0, 0.0], "high": [16.0, 30.0, 8.0]},
    {"kind": "box", "low": [16.0, 20.0, 0.0], "high": [25.0, 22.5, 12.0]},
    {"kind": "box", "low": [4.5, 4.0, 3.0], "high": [9.0, 6.0, 5.0]},
    {"kind": "cylinder", "center": [24.0, 10.0], "radius": 3.0},
    {"kind": "cylinder", "center": [6.0, 14.0], "radius": 2.5, "bottom": 2.0, "top": 6.0},
]
ACCELERATED = {"kind": "point_mass", "speed": 12.0, "acceleration": 30.0, "decision_period": 1.0, "physics_step": 0.5}


def cluttered(action: str, collision: str = "slide", clock: str = "barrier", **changes: Any) -> Scenario:
    vehicle = ACCELERATED if action == "velocity" else {"kind": "grid_hop", "hop_lengths": 3, "speed": 2.0}
    content: dict[str, Any] = {
        "arena": {"size": [30.0, 30.0, 12.0], "obstacles": OBSTACLES, "collision": collision, "clearance": 0.05},
        "team": {"n_uavs": 3, "region": [[0.0, 0.0, 0.0], [30.0, 30.0, 12.0]]},
        "sources": {"region": [[0.0, 0.0, 0.0], [30.0, 30.0, 12.0]], "number": 2},
        "vehicle": vehicle,
        "action": action,
        "clock": clock,
        "ending": {"max_decisions": 100_000, "time_limit": 1e6},
        "energy": {"capacity": 1e9},
    }
    return load_scenario(Scenario.model_validate(content), **changes)


def fly(world: World, rng: np.random.Generator) -> None:
    """A step with random commands, many of them straight along an axis, and beyond the bounds."""
    shape = (world.n_envs, world.n_uavs)
    if world.scenario.action == "hop":
        world.step_hops(rng.integers(0, len(world.hop_offsets), shape))
        return
    moves = rng.normal(size=(*shape, 3)) * np.where(rng.random((*shape, 3)) < 0.4, 0.0, 1.0)
    if world.scenario.action == "velocity":
        world.step_velocities(12.0 * moves)
    else:
        world.step_waypoints(world.motion["position"] + 10.0 * moves, rng.integers(1, 3, shape))


MODES = [("hop", "barrier"), ("hop", "event"), ("waypoint", "barrier"), ("waypoint", "event"), ("velocity", "barrier")]


@pytest.mark.parametrize("collision", ["stop", "slide"])
@pytest.mark.parametrize(("action", "clock"), MODES)
def test_nothing_is_ever_inside_an_obstacle_nor_has_passed_one(action: str, clock: str, collision: str) -> None:
    scenario = cluttered(action, collision, clock)
    arena, world, rng = scenario.arena, World(scenario, 16), np.random.default_rng(1)
    world.reset(np.arange(16))
    t = np.linspace(0.0, 1.0, 60)[:, None]
    for _ in range(100):
        fly(world, rng)
        places = world.motion["position"].reshape(-1, 3)
        assert arena.free(places).all()
        assert (places >= 0.0).all()
        assert (places <= arena.size).all()
        if action != "velocity":
            ways = np.stack([world.motion["origin"], world.motion["target"]]).reshape(2, -1, 3)
            assert arena.free((ways[0] + t[:, None] * (ways[1] - ways[0])).reshape(-1, 3)).all()
    assert world.ledger["collisions"].sum() > 100
    assert world.running.all()


@pytest.mark.parametrize("speed", [12.0, 1000.0])
def test_no_speed_and_no_step_carries_a_uav_through_a_wall(speed: float) -> None:
    wall = {"kind": "box", "low": [14.999, 0.0, 0.0], "high": [15.0, 30.0, 12.0]}
    vehicle = ACCELERATED | {"speed": speed, "acceleration": 1e9}
    arena = {"size": [30.0, 30.0, 12.0], "obstacles": [wall]}
    starts = [[5.0, 5.0 * k, 5.0] for k in range(1, 4)]
    world = World(cluttered("velocity", arena=arena, vehicle=vehicle, team={"region": None, "starts": starts}), 8)
    world.reset(np.arange(8))
    rng = np.random.default_rng(0)
    for _ in range(50):
        world.step_velocities(speed * rng.normal(size=(8, 3, 3)))
        assert (world.motion["position"][..., 0] < 14.999).all()


@pytest.mark.parametrize("action", ["hop", "waypoint"])
def test_time_energy_and_path_are_those_of_what_was_flown(action: str) -> None:
    scenario = cluttered(action)
    world, rng = World(scenario, 8), np.random.default_rng(3)
    world.reset(np.arange(8))
    path = np.zeros((8, 3))
    for _ in range(60):
        before = world.motion["position"].copy()
        fly(world, rng)
        moved = np.linalg.norm(world.motion["position"] - before, axis=-1)
        np.testing.assert_allclose(world.motion["leg_path"], moved, atol=1e-9)
        path += moved
    book, energy = world.ledger, scenario.energy
    np.testing.assert_allclose(book["path"], path, rtol=1e-12)
    np.testing.assert_allclose(book["flying_time"], path / 2.0, rtol=1e-9)
    np.testing.assert_allclose(book["energy"][..., FLYING], energy.flying_power * book["flying_time"])
    np.testing.assert_allclose(book["energy"][..., HOVERING], energy.hovering_power * book["hovering_time"])
    np.testing.assert_allclose(book["energy"][..., TURNING], energy.turn_energy * book["turns"])
    np.testing.assert_allclose(book["spent"], sum(book["energy"][..., k] for k in range(len(ENERGY_KINDS))))
    own = book["search_time"] + book["waiting_time"]
    np.testing.assert_allclose(own, np.broadcast_to(world.episode["clock"][:, None], own.shape))


def against_a_wall(collision: str, angle: float) -> World:
    """One UAV 0.5 m from a wall across x, flying into it at `angle`, rad, to its normal for two periods."""
    arena = {
        "size": [30.0, 30.0, 12.0], "collision": collision, "clearance": 0.05,
        "obstacles": [{"kind": "box", "low": [10.0, 0.0, 0.0], "high": [11.0, 30.0, 12.0]}],
    }  # fmt: skip
    vehicle = ACCELERATED | {"speed": 2.0, "acceleration": 1e9}
    team = {"n_uavs": 1, "region": None, "starts": [[9.5, 10.0, 5.0]]}
    world = World(cluttered("velocity", arena=arena, vehicle=vehicle, team=team))
    world.reset([0])
    command = np.array([[[2.0 * math.cos(angle), 2.0 * math.sin(angle), 0.0]]])
    for _ in range(2):
        world.step_velocities(command)
    return world


def test_slide_keeps_the_motion_along_the_surface() -> None:
    world = against_a_wall("slide", 1.0)
    m = world.motion[0, 0]
    np.testing.assert_allclose(m["position"], [9.95, 10.0 + 4.0 * math.sin(1.0), 5.0], atol=1e-6)
    np.testing.assert_allclose(m["velocity"], [0.0, 2.0 * math.sin(1.0), 0.0], atol=1e-9)
    assert m["collided"]
    assert world.ledger["collisions"][0, 0] == 2
    np.testing.assert_allclose(m["origin"], [9.95, 10.0 + 2.0 * math.sin(1.0), 5.0], atol=1e-6)


def test_stop_holds_the_uav_where_it_hit() -> None:
    world = against_a_wall("stop", 1.0)
    m = world.motion[0, 0]
    np.testing.assert_allclose(m["position"], [9.95, 10.0 + 0.45 * math.tan(1.0), 5.0], atol=1e-6)
    np.testing.assert_array_equal(m["velocity"], 0.0)
    assert world.ledger["path"][0, 0] == pytest.approx(0.45 / math.cos(1.0), abs=1e-6)
    assert world.running[0]


def test_end_ends_the_flight_of_the_uav_that_hit() -> None:
    world = against_a_wall("end", 0.0)
    assert world.motion["terminated"][0, 0]
    assert not world.running[0]
    assert world.ledger["collisions"][0, 0] == 1
    assert world.ledger["search_time"][0, 0] == 0.5  # the physics step in which it hit; no later one
    assert world.motion["samples"][0, 0] == 0


@pytest.mark.parametrize(("action", "clock"), MODES)
def test_end_ends_only_those_that_hit_and_takes_no_sample(action: str, clock: str) -> None:
    world, rng = World(cluttered(action, "end", clock), 32), np.random.default_rng(4)
    world.reset(np.arange(32))
    for _ in range(300):
        before = world.motion["active"].copy()
        fly(world, rng)
        lost = before & ~world.motion["active"]
        assert (world.motion["collided"] & world.motion["terminated"])[lost].all()
        assert (world.motion["samples"][lost] == 0).all()
        assert not (world.motion["active"] & world.motion["ready"] & world.motion["collided"]).any()
        if not world.running.any():
            break
    np.testing.assert_array_equal(world.ledger["collisions"], world.motion["terminated"])
    assert not world.running.any()


@pytest.mark.parametrize("clock", ["barrier", "event"])
def test_masks_are_what_flies(clock: str) -> None:
    world, rng = World(cluttered("hop", clock=clock), 16), np.random.default_rng(5)
    world.reset(np.arange(16))
    view, table = ActionTranslator(world), world.hop_offsets
    refused = 0
    for _ in range(60):
        masks, before = view.masks(), world.motion.copy()
        actions = rng.integers(0, len(table) - 1, (16, 3))
        allowed = np.take_along_axis(masks, actions[..., None], axis=-1)[..., 0]
        world.step_hops(actions)
        ready = before["ready"]
        flown = world.motion["target"] - before["position"]
        as_told = np.linalg.norm(flown - table[actions], axis=-1) < 1e-9
        np.testing.assert_array_equal(as_told[ready], allowed[ready])
        inside = (
            (before["position"] + table[actions] >= 0) & (before["position"] + table[actions] <= [30, 30, 12])
        ).all(-1)
        hit = world.motion["collided"]
        np.testing.assert_array_equal(hit[ready & inside], ~allowed[ready & inside])
        refused += int((ready & inside & ~allowed).sum())
    assert refused > 50


def test_a_blocked_hop_is_the_longest_clear_one() -> None:
    team = {"n_uavs": 1, "region": None, "starts": [[10.0, 12.0, 3.0]]}
    world = World(cluttered("hop", team=team))
    world.reset([0])
    forward = 3 * int(np.flatnonzero((world.hop_offsets[::3] == [1.0, 0.0, 0.0]).all(axis=1))[0])
    world.step_hops(np.array([[forward + 2]]))  # 3 m towards a wall 2 m away
    np.testing.assert_array_equal(world.motion["position"][0, 0], [11.0, 12.0, 3.0])
    world.step_hops(np.array([[forward + 2]]))
    np.testing.assert_array_equal(world.motion["position"][0, 0], [11.0, 12.0, 3.0])
    assert world.ledger["collisions"][0, 0] == 2


@pytest.mark.parametrize(("action", "clock"), MODES)
def test_a_row_of_a_batch_is_a_batch_of_one(action: str, clock: str) -> None:
    scenario = cluttered(action, clock=clock)
    worlds = [World(scenario, 5), World(scenario, 1)]
    for world, seeds in zip(worlds, ([3, 1, 4, 7, 5], [7]), strict=True):
        rng = np.random.default_rng(9)
        world.reset(seeds)
        for _ in range(40):
            moves = rng.normal(size=(1, 3, 3)).repeat(world.n_envs, axis=0)
            if action == "hop":
                world.step_hops(rng.integers(0, len(world.hop_offsets), (1, 3)).repeat(world.n_envs, axis=0))
            elif action == "velocity":
                world.step_velocities(9.0 * moves)
            else:
                world.step_waypoints(15.0 + 9.0 * moves, np.ones((world.n_envs, 3), np.int64))
    for name in ("motion", "ledger", "senses"):
        assert getattr(worlds[0], name)[3].tobytes() == getattr(worlds[1], name)[0].tobytes()


def test_random_places_are_free() -> None:
    world = World(cluttered("hop"), 200)
    world.reset(np.arange(200))
    places = np.concatenate([world.motion["position"].reshape(-1, 3), world.source_position.reshape(-1, 3)])
    assert world.scenario.arena.free(places).all()
    free = World(cluttered("hop", arena={"obstacles": []}), 200)
    free.reset(np.arange(200))
    same = (free.motion["position"] == world.motion["position"]).all(axis=-1)
    assert 0.5 < same[:, 0].mean() < 1.0  # a first draw stands wherever it is free, and only there


@pytest.mark.parametrize(
    ("arena", "message"),
    [
        ({"obstacles": [{"kind": "box", "low": [1, 1, 1], "high": [1, 2, 2]}]}, "must exceed low"),
        ({"obstacles": [{"kind": "box", "low": [-5, 1, 1], "high": [-1, 2, 2]}]}, "obstacles.0: this box is outside"),
        ({"obstacles": [{"kind": "cylinder", "center": [1, 1], "radius": 0}]}, "radius"),
        ({"obstacles": [{"kind": "cone", "center": [1, 1]}]}, "obstacles.0.kind = 'cone': allowed are box, cylinder"),
        ({"obstacles": 3}, "must be a list"),
        ({"obstacles": [{"kind": "box", "low": [1, 1, 1], "high": [2, 2, 2], "hue": 1}]}, "hue"),
        ({"clearance": 0.0}, "clearance"),
        ({"collision": "bounce"}, "collision"),
        ({"occupancy": "no-such-field"}, "no-such-field"),
    ],
)
def test_bad_obstacles_are_refused_in_one_line(arena: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        load_scenario("rate-60x60x30", arena=arena)
    assert "\n" not in str(error.value)
    assert "arena" in str(error.value)


def test_a_source_or_a_start_in_an_obstacle_is_refused() -> None:
    box = [{"kind": "box", "low": [0.0, 0.0, 0.0], "high": [100.0, 20.0, 30.0]}]
    with pytest.raises(InputError, match=r"starts.*obstacle"):
        load_scenario("rate-100x60x30", arena={"obstacles": box})


def test_a_scenario_without_obstacles_keeps_its_hash() -> None:
    plain = load_scenario("rate-60x60x30")
    assert plain.override(arena={"obstacles": [], "collision": "slide"}).hash == plain.hash
    boxed = plain.override(arena={"obstacles": [{"kind": "box", "low": [50, 50, 0], "high": [52, 52, 9]}]})
    assert boxed.hash != plain.hash
    assert boxed.arena.geometry.boxes.shape == (1, 6)


def test_the_arena_answers_planners() -> None:
    arena = Arena(size=(30.0, 30.0, 12.0), obstacles=OBSTACLES)  # type: ignore[arg-type]
    assert not arena.is_free((14.0, 20.0, 4.0))
    assert not arena.is_free((11.995, 20.0, 4.0))
    assert arena.is_free((11.98, 20.0, 4.0))
    assert arena.clear((5.0, 20.0, 10.0), (20.0, 15.0, 10.0))
    assert not arena.clear((5.0, 20.0, 4.0), (20.0, 15.0, 4.0))
    assert not arena.has_room(((12.5, 12.0, 1.0), (15.0, 28.0, 7.0)))
    assert arena.has_room(((12.5, 12.0, 1.0), (15.0, 28.0, 9.0)))


@pytest.mark.parametrize("layers", [1, 12])
def test_the_solid_cells_of_a_field_are_obstacles(tmp_path: Path, layers: int) -> None:
    solid = np.zeros((15, 15, layers), np.uint8)
    solid[6:8, 5:15] = 1  # x from 12 to 16, y from 10 on
    field = Field(
        times=np.zeros(1),
        origin=np.array([101.0, 1.0, 0.5]),
        spacing=np.array([2.0, 2.0, 1.0]),
        wind=np.zeros((1, 15, 15, layers, 3), np.float32),
        solid=solid,
    )
    save_field(field, tmp_path / "rooms.npz")
    occupancy = {"field": str(tmp_path / "rooms.npz"), "offset": [-100.0, 0.0, 0.0]}
    arena: dict[str, Any] = {"size": [30.0, 30.0, 12.0], "obstacles": [], "occupancy": occupancy}
    world, rng = World(cluttered("velocity", arena=arena), 8), np.random.default_rng(2)
    assert not world.scenario.arena.is_free((14.0, 20.0, 11.99))
    assert not world.scenario.arena.is_free((14.0, 20.0, 12.0))
    assert world.scenario.arena.is_free((14.0, 9.9, 4.0))
    world.reset(np.arange(8))
    for _ in range(50):
        fly(world, rng)
        x, y, _ = np.moveaxis(world.motion["position"], -1, 0)
        assert not ((x > 11.96) & (x < 16.04) & (y > 9.96)).any()
    assert world.ledger["collisions"].sum() > 10
    with pytest.raises(InputError, match="do not cover the arena"):
        load_scenario("rate-60x60x30", arena={"occupancy": occupancy})
