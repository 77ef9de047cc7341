"""Spaces of one UAV, and the step of a view: actions as `osl_env.agent_actions` defines them, checked and flown."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from osl_env.agent_actions import (
    BOX_SIZES,
    box_declares,
    box_setpoints,
    box_velocities,
    box_waypoints,
    n_hop_actions,
)
from osl_env.errors import InputError
from osl_env.flying import mask_blocked_hops
from osl_env.observation import Observation, ObservationLayout
from osl_env.parameters import FloatArray
from osl_env.scenario import Scenario
from osl_env.state import IntArray
from osl_env.streams import check_seed, entropy_seed, next_episode_seed
from osl_env.world import World


def uav_action_space(scenario: Scenario) -> spaces.Space[Any]:
    """The action space of one UAV."""
    if scenario.action == "hop":
        return spaces.Discrete(n_hop_actions(scenario.vehicle.hop_lengths))
    return spaces.Box(-1.0, 1.0, (BOX_SIZES[scenario.action],), np.float32)


def flat_space(size: int) -> spaces.Box:
    """The space of normalised observations of `size` numbers."""
    return spaces.Box(-1.0, 1.0, (size,), np.float32)


def physical_space(layout: ObservationLayout) -> spaces.Dict:
    """The space of one UAV's physical observation: what `physical_dict` gives."""
    sample = physical_dict(layout.observation(np.zeros(layout.size)), np.zeros(3))
    members: dict[str, spaces.Space[Any]] = {
        name: spaces.Box(-np.inf, np.inf, values.shape, np.float64) for name, values in sample.items()
    }
    return spaces.Dict(members)


def physical_dict(observation: Observation, area: FloatArray) -> dict[str, FloatArray]:
    """The named physical quantities of an Observation, as fresh float64 arrays."""
    named: dict[str, FloatArray] = {"area": area.copy()}
    for name in Observation.__slots__:
        named[name] = np.atleast_1d(np.array(getattr(observation, name), dtype=np.float64))
    return named


def action_array(actions: Any) -> NDArray[Any]:
    """`actions` as an array. Raises InputError if they are ragged."""
    try:
        return np.asarray(actions)
    except ValueError:
        raise InputError("actions: must be an array of numbers, the same for each UAV") from None


class ActionTranslator:
    """Checks the actions (n_envs, n_uavs, ..) of a view, and steps its world with them."""

    def __init__(self, world: World) -> None:
        """A translator for the scenario's action mode."""
        self.world = world
        self.mode = world.scenario.action
        self.space = uav_action_space(world.scenario)
        self.shape: tuple[int, ...] = (world.n_envs, world.n_uavs)
        if isinstance(self.space, spaces.Box):
            self.shape += self.space.shape
        self.n_actions = int(self.space.n) if isinstance(self.space, spaces.Discrete) else 0
        self._area = np.array(world.scenario.arena.size)

    def step(self, actions: Any) -> None:
        """Step the world. Raises InputError if the actions have a wrong shape or type or are out of bounds."""
        array = action_array(actions)
        if array.shape != self.shape:
            raise InputError(f"actions: must have the shape {self.shape}, not {array.shape}")
        if self.mode == "hop":
            self.world.step_hops(self._hops(array))
        else:
            self._step_box(array)

    def _hops(self, array: NDArray[Any]) -> IntArray:
        if array.dtype.kind not in "iu":
            raise InputError(f"actions: must be integers, not {array.dtype}")
        if array.min() < 0 or array.max() >= self.n_actions:
            raise InputError(f"actions: must be from 0 to {self.n_actions - 1}, not {array.min()} to {array.max()}")
        return np.ascontiguousarray(array, dtype=np.int64)

    def _step_box(self, array: NDArray[Any]) -> None:
        if array.dtype.kind != "f":
            raise InputError(f"actions: must be floating point numbers, not {array.dtype}")
        values = array.astype(np.float64)
        if not (np.abs(values) <= 1.0).all():
            raise InputError("actions: must be finite and from -1 to 1")
        declaring = box_declares(values)
        places = None
        if declaring.any():
            places = np.where(declaring[..., None], self.world.motion["position"], np.nan)
        vehicle = self.world.scenario.vehicle
        if self.mode == "velocity":
            self.world.step_velocities(box_velocities(values, vehicle.speed), places)
            return
        if self.mode == "setpoint":
            here = self.world.motion["position"]
            self.world.step_setpoints(box_setpoints(values, here, vehicle.lookahead), places)
            return
        targets, samples = box_waypoints(values, self._area, vehicle.max_samples)
        self.world.step_waypoints(targets, samples, places)

    def masks(self) -> NDArray[np.bool_]:
        """Which hops end inside the area and meet no obstacle: (n_envs, n_uavs, n_actions) bool; hovering and declaring
        always may.
        """
        if self.mode != "hop":
            raise InputError(f"action masks: only for action 'hop', not {self.mode!r}")
        offsets = self.world.hop_offsets
        ends = self.world.motion["position"][..., None, :] + offsets
        inside: NDArray[np.bool_] = np.asarray(((ends >= 0.0) & (ends <= self._area)).all(axis=-1))
        arena = self.world.scenario.arena
        if arena.obstructed:
            mask_blocked_hops(self.world.motion, arena.geometry, offsets[:-1], inside)
        return np.concatenate([inside, np.ones((*inside.shape[:2], 1), np.bool_)], axis=-1)


def next_seed(world: World, seed: int | None) -> int:
    """The seed of the next episode of a single world: `seed`, or what follows its present one."""
    if seed is not None:
        return check_seed(seed)
    if world.begun[0]:
        return int(next_episode_seed(int(world.episode["seed"][0])))
    return entropy_seed()
