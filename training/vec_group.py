"""One scenario's share of a `UavVecEnv`: its worlds stepped as one batch, with one slot for each UAV.

Slots are ordered world by world, UAV by UAV. A group may have more slots than UAVs, so that scenarios with teams of
different sizes can take each other's place; the slots left over are idle for ever.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.features import FeatureBank, FeatureSpec
from osl_env.envs.spaces import ActionTranslator
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.state import SUCCESS, BoolArray, IntArray
from osl_env.streams import following_seeds
from osl_env.world import World


class SharedInfo(dict[str, Any]):
    """An info that many slots share in a step, and that therefore refuses to be written."""

    def __setitem__(self, key: str, value: Any) -> None:
        """Refused."""
        raise TypeError(f"infos[..][{key!r}]: this info is shared by all slots without news; copy it first")

    def update(self, *others: Any, **values: Any) -> None:
        """Refused."""
        self["update"] = None

    def setdefault(self, key: str, default: Any = None) -> Any:
        """Refused."""
        self[key] = default

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy is a plain dict."""
        return dict, (dict(self),)


NOTHING = SharedInfo()
IDLE = SharedInfo(idle=True)


class Slot:
    """What `get_attr` and `env_method` see of one slot."""

    def __init__(self, groups: list[Group], number: int, index: int) -> None:
        """Slot number `index` of the group `number` of `groups`, which may be exchanged."""
        self.render_mode: str | None = None
        self._groups, self._number, self.index = groups, number, index

    @property
    def group(self) -> Group:
        """The group that the slot belongs to now."""
        return self._groups[self._number]

    @property
    def scenario(self) -> Scenario:
        """The scenario that the slot's UAV flies in."""
        return self.group.scenario

    @property
    def episode_seed(self) -> int | None:
        """The seed of the running episode; None where the slot is no UAV's."""
        if self.index >= self.group.used:
            return None
        return int(self.group.seeds[self.index // self.group.world.n_uavs])

    def action_masks(self) -> BoolArray:
        """Which actions make sense: (n_actions,) bool."""
        row: BoolArray = self.group.action_masks()[self.index]
        return row

    def render(self) -> None:
        """Nothing is drawn."""


class Group:
    """`n_worlds` worlds of `scenario`, seen as `n_slots` slots."""

    def __init__(self, scenario: Scenario, n_worlds: int, n_slots: int, features: FeatureSpec) -> None:
        """Make the worlds; `begin` comes before the first step."""
        self.scenario, self.n_slots = scenario, n_slots
        self.world = World(scenario, n_worlds)
        self.bank = FeatureBank(features, scenario, n_worlds)
        self.used = self.world.motion.size  # slots that are UAVs'
        self._translator = ActionTranslator(self.world)
        self._flying: BoolArray = np.zeros(self.world.motion.shape, np.bool_)  # since the step before
        self._returns = np.zeros(self.world.motion.shape)
        self._lengths: IntArray = np.zeros(self.world.motion.shape, np.int64)
        if self.used > n_slots:
            raise InputError(f"n_slots = {n_slots}: {n_worlds} worlds of {self.world.n_uavs} UAVs need {self.used}")

    @property
    def seeds(self) -> IntArray:
        """(n_worlds,): the seeds of the running episodes."""
        seeds: IntArray = self.world.episode["seed"]
        return seeds

    @property
    def idle(self) -> BoolArray:
        """(n_slots,) bool: the slots whose UAV has ended before its team, or that are no UAV's."""
        idle: BoolArray = np.ones(self.n_slots, np.bool_)
        idle[: self.used] = ~self._flying.reshape(-1)
        return idle

    def action_masks(self) -> BoolArray:
        """Which hops end inside the area: (n_slots, n_actions) bool."""
        masks = self._translator.masks().reshape(self.used, -1)
        return np.concatenate([masks, np.ones((self.n_slots - self.used, masks.shape[1]), np.bool_)])

    def begin(self, seeds: IntArray, observations: NDArray[np.float32]) -> None:
        """Begin the episodes with `seeds` (n_worlds,); writes `observations` (n_slots, size)."""
        self.world.reset(seeds)
        self.bank.reset()
        self.bank.update(self.world, out=self._rows(observations))
        observations[self.used :] = 0.0
        self._flying[:] = self.world.motion["active"]
        self._returns[:], self._lengths[:] = 0.0, 0

    def _rows(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return observations[: self.used].reshape(*self.world.motion.shape, -1)

    def step(
        self,
        actions: NDArray[Any],
        observations: NDArray[np.float32],
        rewards: NDArray[np.float32],
        dones: BoolArray,
        began: float,
    ) -> list[dict[str, Any]]:
        """One decision of every UAV with `actions` (n_slots, ..); worlds that end begin their next episodes.

        Writes `observations` (n_slots, size), `rewards` and `dones` (n_slots,), which must be zero. Returns the infos.
        `began`: the clock's reading to which the episodes' `t` refers, s.
        """
        world = self.world
        self._translator.step(actions[: self.used].reshape(self._translator.shape))
        rows = self._rows(observations)
        self.bank.update(world, out=rows)
        rewards[: self.used] = world.rewards.reshape(-1)
        self._returns += world.rewards
        self._lengths += self._flying
        ended, idle = ~world.running, ~self._flying
        done = (self._flying & ~world.motion["active"]) | ended[:, None]
        infos: list[dict[str, Any]] = [NOTHING] * self.n_slots
        if idle.any():
            rows[idle] = 0.0
            for slot in np.flatnonzero(idle).tolist():
                infos[slot] = IDLE
        if done.any():
            dones[: self.used] = done.reshape(-1)
            self._report(done, idle, ended, world.motion["truncated"], rows, infos, began)
            rows[done] = 0.0
        if ended.any():
            world.reset(following_seeds(self.seeds), ended)
            self.bank.reset(ended)
            self.bank.update(world, ended, rows)
            self._returns[ended], self._lengths[ended] = 0.0, 0
        self._flying[:] = world.motion["active"]
        if self.used < self.n_slots:
            observations[self.used :] = 0.0
            infos[self.used :] = [IDLE] * (self.n_slots - self.used)
        return infos

    def cut(
        self, observations: NDArray[np.float32], dones: BoolArray, infos: list[dict[str, Any]], began: float
    ) -> None:
        """End all that goes on after a step, as if time were up: the group is about to be exchanged.

        `observations`, `dones` and `infos` of the group's slots are those of the step; completes the latter two.
        """
        done = ~dones[: self.used].reshape(self.world.motion.shape)
        nobody = np.zeros(self.world.n_envs, np.bool_)
        everybody: BoolArray = np.ones(done.shape, np.bool_)
        self._report(done, ~self._flying, nobody, everybody, self._rows(observations), infos, began)
        for slot in range(self.used, self.n_slots):
            infos[slot] = {
                "terminal_observation": observations[slot].copy(),
                "TimeLimit.truncated": False,
                "idle": True,
            }
        dones[:] = True

    def _report(
        self,
        done: BoolArray,
        idle: BoolArray,
        ended: BoolArray,
        truncated: BoolArray,
        rows: NDArray[np.float32],
        infos: list[dict[str, Any]],
        began: float,
    ) -> None:
        """The infos of the slots that are `done` (n_worlds, n_uavs)."""
        slots = np.flatnonzero(done)
        last = rows[done]
        success = self.world.episode["outcome"] == SUCCESS
        columns = zip(
            slots.tolist(),
            (slots // self.world.n_uavs).tolist(),
            last,
            (truncated & ~idle)[done].tolist(),
            idle[done].tolist(),
            self._returns[done].tolist(),
            self._lengths[done].tolist(),
            strict=True,
        )
        elapsed = round(time.perf_counter() - began, 6)
        for slot, env, row, cut, was_idle, total, length in columns:
            info: dict[str, Any] = {"terminal_observation": row, "TimeLimit.truncated": cut}
            if was_idle:
                info["idle"] = True
            else:
                info["episode"] = {"r": total, "l": length, "t": elapsed}
            if ended[env]:
                info["is_success"] = bool(success[env])
            infos[slot] = info
