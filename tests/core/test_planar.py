"""Robots on the ground: nothing vertical in what they are told counts, whatever the command."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import small

from osl_env.world import World


def world(**changes: Any) -> World:
    made = World(small(**{"vehicle": {"kind": "point_mass", "planar": True}} | changes), 2)
    made.reset([1, 2])
    return made


@pytest.mark.parametrize("action", ["velocity", "setpoint", "waypoint", "hop"])
def test_ground_robots_stay_at_their_height(action: str) -> None:
    flown = world(action=action)
    height = flown.motion["position"][..., 2].copy()
    before = flown.motion["position"][..., 0].copy()
    shape = (2, flown.n_uavs)
    match action:
        case "velocity":
            flown.step_velocities(np.broadcast_to([0.5, 0.1, 0.7], (*shape, 3)).copy())
        case "setpoint":
            flown.step_setpoints(flown.motion["position"] + [0.5, 0.1, 3.0])
        case "waypoint":
            flown.step_waypoints(flown.motion["position"] + [0.5, 0.1, 3.0], np.ones(shape, np.int64))
        case "hop":  # the last of the 26 directions is (1, 1, 1)
            flown.step_hops(np.full(shape, 25))
    assert np.array_equal(flown.motion["position"][..., 2], height)
    assert np.abs(flown.motion["position"][..., 0] - before).max() > 0.0


def test_a_hop_straight_up_is_staying_and_costs_no_flight() -> None:
    flown = world(action="hop")
    before = flown.motion["position"].copy()
    flown.step_hops(np.full((2, flown.n_uavs), 13))  # of the 26 directions: (0, 0, 1)
    assert np.array_equal(flown.motion["position"], before)
    assert flown.ledger["path"].max() == 0.0


def test_flat_commands_do_the_same_to_both() -> None:
    flat, free = world(action="velocity"), world(**{"action": "velocity", "vehicle.planar": False})
    velocities = np.broadcast_to([0.4, -0.3, 0.0], (2, flat.n_uavs, 3)).copy()
    for _ in range(5):
        flat.step_velocities(velocities)
        free.step_velocities(velocities)
    assert np.array_equal(flat.motion["position"], free.motion["position"])
    assert flat.scenario.hash != free.scenario.hash
