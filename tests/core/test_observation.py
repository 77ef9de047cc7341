"""Observations: physical and normalised from one definition, bounded, masked, nearest neighbours first."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import NOISY, advance, begun, flying, random_commands, small

from osl_env import World
from osl_env.observation import Field, Observation
from osl_env.parameters import FloatArray

CASES: dict[str, dict[str, Any]] = {
    "plain": {},
    "noisy": NOISY,
    "event": {"clock": "event", "team.n_uavs": 5},
    "velocity": {"vehicle": {"kind": "point_mass"}, "action": "velocity"},
    "setpoint": {"vehicle": {"kind": "point_mass"}, "action": "setpoint"},
    "alone": {"team.n_uavs": 1},
    "few neighbours": {"team.n_uavs": 5, "max_neighbours": 2},
    "no neighbours": {"max_neighbours": 0},
    "large": {"arena.size": (20.0, 500.0, 10.0)},
    "inexact": {"team.starts": [(0.1 + 0.7 * k, 0.3, 0.7) for k in range(8)], "team.n_uavs": 8, "max_neighbours": 4},
}


def normalised(field: Field, values: FloatArray) -> FloatArray:
    scale = np.tile(field.scale, field.size // len(field.scale))
    result = values * scale + field.offset if field.normalised == "linear" else values / (np.abs(values) + scale)
    return np.clip(result, -1.0, 1.0)


@pytest.fixture(params=CASES)
def world(request: pytest.FixtureRequest) -> World:
    return begun(small(**CASES[request.param]), [1, 2, 3])


def test_the_flat_vector_is_the_physical_row_by_the_field_table(world: World) -> None:
    rng, layout = np.random.default_rng(0), world.layout
    for _ in range(15):
        physical, flat = world.physical, layout.flat(world)
        expected, at = [], 0
        for field in layout.fields:
            values = physical[..., at : at + field.size]
            at += field.size
            if field.normalised != "no":
                expected.append(normalised(field, values))
        assert at == layout.size == physical.shape[-1]
        vector = np.concatenate(expected, axis=-1)
        assert vector.shape == flat.shape == (3, world.n_uavs, layout.flat_size)
        np.testing.assert_allclose(flat, vector, atol=2e-6)
        assert flat.dtype == np.float32
        assert np.abs(flat).max() <= 1.0
        advance(world, random_commands(world, rng))


def test_the_named_observation_is_the_row(world: World) -> None:
    advance(world, random_commands(world, np.random.default_rng(0)))
    for uav in range(world.n_uavs):
        observation = world.observation(1, uav)
        row, at = world.physical[1, uav], 0
        seen: dict[str, list[float]] = {}
        for field in world.layout.fields:
            seen.setdefault(field.name, []).extend(row[at : at + field.size].tolist())
            at += field.size
        assert set(seen) - {"area"} <= set(Observation.__slots__)
        for name, values in seen.items():
            if name != "area":
                assert np.ravel(getattr(observation, name)).tolist() == values, name


def test_the_observation_is_the_state_that_it_tells(world: World) -> None:
    rng = np.random.default_rng(1)
    for _ in range(5):
        advance(world, random_commands(world, rng))
    for uav in range(world.n_uavs):
        observation, motion = world.observation(2, uav), world.motion[2, uav]
        ledger, senses = world.ledger[2, uav], world.senses[2, uav]
        assert observation.time == world.episode["clock"][2]
        assert observation.decision == ledger["decisions"]
        assert observation.ready == bool(motion["ready"] and motion["active"])
        assert observation.position.tolist() == motion["position"].tolist()
        assert observation.velocity.tolist() == motion["velocity"].tolist()
        assert observation.wind.tolist() == senses["wind"].tolist()
        assert (observation.reading, observation.sampling_time) == (senses["reading"], senses["sampling_time"])
        assert observation.energy_left == world.scenario.energy.capacity - ledger["spent"]
        assert observation.time_left == max(0.0, world.scenario.ending.time_limit - ledger["search_time"])


def test_masked_entries_hold_zeros(world: World) -> None:
    rng = np.random.default_rng(2)
    for _ in range(8):
        for env in range(3):
            for uav in range(world.n_uavs):
                o = world.observation(env, uav)
                missing = ~o.detection_mask
                assert not np.any([o.detection_age[missing].any(), o.detection_offset[missing].any()])
                assert not o.detection_reading[missing].any()
                absent = ~o.neighbour_mask
                assert not np.any([o.neighbour_offset[absent].any(), o.neighbour_reading[absent].any()])
                assert not np.any([o.neighbour_age[absent].any(), o.neighbour_sampling_time[absent].any()])
                assert (o.neighbour_id[absent] == -1).all()
                assert uav not in o.neighbour_id
        advance(world, random_commands(world, rng))


@pytest.mark.parametrize("radius", [float("inf"), 14.0])
def test_the_nearest_neighbours_come_first(radius: float) -> None:
    starts = np.random.default_rng(3).uniform((0, 0, 0), (20, 20, 10), (12, 3)).tolist()
    team = {"team.n_uavs": 12, "team.starts": starts, "max_neighbours": 4, "radio.radius": radius}
    world = begun(small(**team), [1, 2])
    rng = np.random.default_rng(4)
    for _ in range(10):
        for uav in range(12):
            place = world.motion["position"][0]
            distance = np.linalg.norm(place - place[uav], axis=1)
            order = np.argsort(distance, kind="stable")
            heard = set(np.flatnonzero(world.links[0, :, uav]).tolist())
            expected = [int(k) for k in order if k != uav and int(k) in heard][:4]
            observation = world.observation(0, uav)
            count = int(observation.neighbour_mask.sum())
            assert observation.neighbour_mask.tolist() == [k < count for k in range(4)]
            if radius == float("inf"):
                assert observation.neighbour_id.tolist() == expected
            ages = observation.neighbour_age[:count]
            lengths = np.linalg.norm(observation.neighbour_offset[:count], axis=1)
            assert np.all(np.diff(lengths) >= -1e-12)
            fresh = observation.neighbour_id[:count][ages == 0].tolist()
            assert fresh == [k for k in observation.neighbour_id[:count].tolist() if k in heard]
        advance(world, random_commands(world, rng))


def test_equally_near_neighbours_keep_the_order_of_their_numbers_in_both_forms() -> None:
    """On a symmetric formation with inexact coordinates, the normalised vector must not order them differently."""
    centre, arms = np.array([10.1, 10.3, 5.7]), 0.1 * np.array([[3, 0, 0], [0, 3, 0], [-3, 0, 0], [0, -3, 0]])
    starts = [tuple(centre.tolist()), *[tuple((centre + arm).tolist()) for arm in arms]]
    world = begun(small(**{"team.n_uavs": 5, "team.starts": starts}))
    columns = np.concatenate([np.full(f.size, f.name == "neighbour_offset") for f in world.layout.fields])
    physical = world.physical[0, 0][columns].reshape(4, 3)
    flat = world.layout.flat(world)[0, 0][columns[: world.layout.flat_size]].reshape(4, 3)
    np.testing.assert_allclose(flat, physical / 20.0, atol=1e-6)


def test_observations_of_an_ended_world_do_not_change() -> None:
    world = begun(small(**{"ending.max_decisions": 2}))
    for _ in range(2):
        advance(world, random_commands(world, np.random.default_rng(0)))
    before = world.physical.copy(), world.layout.flat(world)
    advance(world, random_commands(world, np.random.default_rng(0)))
    assert np.array_equal(world.physical, before[0])
    assert np.array_equal(world.layout.flat(world), before[1])


def test_velocity_is_seen_in_flight() -> None:
    world = begun(flying())
    world.step_velocities(np.full((1, 3, 3), 0.5))
    np.testing.assert_allclose(world.observation(0, 0).velocity, [0.5, 0.5, 0.5], atol=1e-9)
