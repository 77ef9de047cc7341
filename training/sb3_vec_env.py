"""SB3's `VecEnv` on the batch itself: one slot a UAV, all of which learn one shared policy.

Worlds of one scenario are stepped as one batch; several scenarios stand side by side as groups, if their action spaces
are the same. Slots are ordered group by group, world by world, UAV by UAV. A world that ends begins its next episode
within the same step, as SB3 wants it: the last observation is in the info's `terminal_observation`, and
`TimeLimit.truncated` says that time or decisions were used up (not the battery, not a declaration).

A UAV that ends before its team is done at that step. Until its world begins anew its slot is idle: observations of
zeros, rewards of 0, actions ignored, and `infos[slot]["idle"]`; that rest is an episode of its own, which ends with the
world's and has no `episode` in its info. Learning then finds that zeros are worth 0 whatever is done there, which
changes nothing elsewhere; a learner that would rather leave them out finds them in `idle`. On the event clock, UAVs
whose leg goes on ignore their actions too, and observe `ready` = 0.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv

from baselines.features import DEFAULT_FEATURES, FeatureSpec, make_spec, spec_size
from osl_env.envs.spaces import action_array, flat_space, uav_action_space
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import BoolArray
from osl_env.streams import Purpose, check_seed, following_seeds, generator
from training.randomisation import Randomisation
from training.vec_group import Group, Slot


class UavVecEnv(VecEnv):
    """`n_worlds` worlds of one or several scenarios as an SB3 `VecEnv` with a slot for each UAV."""

    def __init__(
        self,
        scenarios: str | Scenario | Sequence[str | Scenario] | Randomisation,
        n_worlds: int,
        features: FeatureSpec = DEFAULT_FEATURES,
        seed: int = 0,
    ) -> None:
        """`n_worlds` in all, spread evenly over the scenarios; `features` make the observation.

        World k begins with the episode that follows seed `seed` + k, and goes on from each episode to the one that
        follows it. Raises InputError if there are fewer worlds than scenarios, or if action spaces differ.

        With a Randomisation there are as many slots as `n_worlds` teams of its base scenario need, or its largest team
        needs in each group; a group holds as many worlds as fit into its slots, and what is left over is idle.
        """
        self.features = make_spec(features)
        self.size = spec_size(self.features)  # numbers of an observation
        self._seed, self._draws = check_seed(seed), 0
        self.randomisation = scenarios if isinstance(scenarios, Randomisation) else None
        plans = self._drawn_plans(n_worlds) if self.randomisation else _fixed_plans(scenarios, n_worlds)
        self.groups = [Group(*plan, self.features) for plan in plans]
        space = self._common_action_space()
        worlds = sum(group.world.n_envs for group in self.groups)
        check_seed(self._seed + worlds)
        self._first = following_seeds(self._seed + np.arange(worlds, dtype=np.int64))
        self._actions: NDArray[Any] = np.zeros(0)
        self._action_shape: tuple[int, ...] = space.shape
        self._began = time.perf_counter()
        self._redraw: tuple[float, int] | None = None  # progress, and how many groups
        self._age = 0  # decisions since groups were exchanged
        self._oldest = 0  # the group that was drawn longest ago
        self._slots = [
            Slot(self.groups, number, index)
            for number, group in enumerate(self.groups)
            for index in range(group.n_slots)
        ]
        super().__init__(len(self._slots), flat_space(self.size), space)

    def _drawn_plans(self, n_worlds: int) -> list[tuple[Scenario, int, int]]:
        assert self.randomisation is not None
        base, groups = self.randomisation.check(), self.randomisation.groups
        _check_count(n_worlds, groups)
        n_slots = max(-(-n_worlds // groups) * base.team.n_uavs, self.randomisation.max_uavs)
        drawn = self._drawn(0.0, groups)
        return [(scenario, n_slots // scenario.team.n_uavs, n_slots) for scenario in drawn]

    def _drawn(self, progress: float, count: int) -> list[Scenario]:
        """The next `count` scenarios of the randomisation."""
        assert self.randomisation is not None
        rng = generator(self._seed, Purpose.SCENARIO, self._draws)
        self._draws += 1
        return self.randomisation.draw(progress, count, rng)

    def _common_action_space(self) -> Any:
        first = self.groups[0].scenario
        space = uav_action_space(first)
        for group in self.groups[1:]:
            scenario = group.scenario
            if uav_action_space(scenario) != space or scenario.action != first.action:
                raise InputError(f"scenarios: {first.name!r} and {scenario.name!r} have different action spaces")
        return space

    def redraw(self, progress: float, share: float | None = None) -> None:
        """Draw new scenarios for a `share` of the groups (by default the Randomisation's), those drawn longest ago.

        That happens at the end of the next step, or of that with which `redraw_every` decisions lie behind the last
        time; until then, another call takes this one's place. `progress` is the share of the training that is done (for
        the curriculum). Episodes that go on in those groups are cut as if time were up. Without a Randomisation nothing
        happens.
        """
        if share is None:
            share = self.randomisation.redraw if self.randomisation else 1.0
        if not 0.0 <= progress <= 1.0 or not 0.0 < share <= 1.0:
            raise InputError(f"progress = {progress}, share = {share}: must be from 0 to 1, a share above 0")
        if self.randomisation is not None:
            self._redraw = (progress, max(1, round(share * len(self.groups))))

    def _exchange(self, observations: Any, dones: BoolArray, infos: list[dict[str, Any]]) -> None:
        """Put newly drawn groups in the place of the oldest, after a step."""
        assert self._redraw is not None
        progress, count = self._redraw
        self._redraw, self._age = None, 0
        n_slots = self.groups[0].n_slots
        for scenario in self._drawn(progress, count):
            number = self._oldest
            self._oldest = (number + 1) % len(self.groups)
            own, old = slice(number * n_slots, (number + 1) * n_slots), self.groups[number]
            told = infos[own]
            old.cut(observations[own], dones[own], told, self._began)
            infos[own] = told
            new = Group(scenario, n_slots // scenario.team.n_uavs, n_slots, self.features)
            first = np.int64(old.seeds[0] >> 1)
            new.begin(following_seeds(first + np.arange(new.world.n_envs)), observations[own])
            self.groups[number] = new

    @property
    def idle(self) -> BoolArray:
        """(num_envs,) bool: the slots that rest (see above)."""
        return np.concatenate([group.idle for group in self.groups])

    def reset(self) -> NDArray[np.float32]:
        """Begin all worlds anew: each with what `seed` gave its first slot, or with the episode that comes next."""
        observations = np.empty((self.num_envs, self.size), dtype=np.float32)
        start, world = 0, 0
        for group in self.groups:
            seeds = self._first[world : world + group.world.n_envs].copy()
            if group.world.begun.all():
                seeds = following_seeds(group.seeds)
            given = self._seeds[start : start + group.used : group.world.n_uavs]
            for env, seed in enumerate(given):
                if seed is not None:
                    seeds[env] = check_seed(seed)
            group.begin(seeds, observations[start : start + group.n_slots])
            start, world = start + group.n_slots, world + group.world.n_envs
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Any) -> None:
        """Take `actions` (num_envs, ..) for `step_wait`. Raises InputError if they are not of that shape."""
        array = action_array(actions)
        if array.shape != (self.num_envs, *self._action_shape):
            expected = (self.num_envs, *self._action_shape)
            raise InputError(f"actions: must have the shape {expected}, not {array.shape}")
        if not self.groups[0].world.begun.all():
            raise InputError("step: call reset first")
        self._actions = array

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], BoolArray, list[dict[str, Any]]]:
        """One decision of every UAV: fresh observations, rewards, dones, and infos (see above)."""
        count = self.num_envs
        observations = np.empty((count, self.size), dtype=np.float32)
        rewards, dones = np.zeros(count, dtype=np.float32), np.zeros(count, dtype=np.bool_)
        infos: list[dict[str, Any]] = []
        start = 0
        for group in self.groups:
            own = slice(start, start + group.n_slots)
            infos += group.step(self._actions[own], observations[own], rewards[own], dones[own], self._began)
            start = own.stop
        self._age += 1
        if self._redraw is not None and self.randomisation and self._age >= self.randomisation.redraw_every:
            self._exchange(observations, dones, infos)
        return observations, rewards, dones, infos

    def close(self) -> None:
        """Nothing to release; may be called again and again."""

    def _chosen(self, indices: Any) -> list[Slot]:
        return [self._slots[index] for index in self._get_indices(indices)]

    def get_attr(self, attr_name: str, indices: int | Iterable[int] | None = None) -> list[Any]:
        """The attribute of each slot: one that was set, or one of `Slot`. Raises AttributeError if there is none."""
        return [getattr(slot, attr_name) for slot in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: int | Iterable[int] | None = None) -> None:
        """Set an attribute of each slot, for `get_attr`; it changes no simulation."""
        for slot in self._chosen(indices):
            setattr(slot, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: int | Iterable[int] | None = None, **method_kwargs: Any
    ) -> list[Any]:
        """What the method of each slot returns; `action_masks` is computed for all of them at once."""
        if method_name == "action_masks" and indices is None:
            return list(np.concatenate([group.action_masks() for group in self.groups]))
        return [getattr(slot, method_name)(*method_args, **method_kwargs) for slot in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: int | Iterable[int] | None = None) -> list[bool]:
        """True for SB3's `Monitor`, for whose `episode` infos the env cares itself; there are no other wrappers."""
        return [wrapper_class is Monitor] * len(self._chosen(indices))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """None for each slot: nothing is drawn."""
        return [None] * self.num_envs

    def state_dict(self) -> dict[str, Any]:
        """What a resume needs, as plain lists and numbers: the running episodes' seeds, and what was drawn."""
        state: dict[str, Any] = {"seeds": [group.seeds.tolist() for group in self.groups]}
        if self.randomisation is not None:
            drawn = [group.scenario.model_dump(mode="json") for group in self.groups]
            state |= {"scenarios": drawn, "draws": self._draws, "oldest": self._oldest, "age": self._age}
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Let the next `reset` begin the episodes that were running when `state` was taken, from their start.

        Raises InputError if `state` is that of an environment with other groups.
        """
        seeds = state.get("seeds")
        if self.randomisation is not None and len(state.get("scenarios", ())) == len(self.groups):
            self._draws, self._oldest, self._age = (int(state[key]) for key in ("draws", "oldest", "age"))
            for number, content in enumerate(state["scenarios"]):
                scenario, n_slots = Scenario.model_validate(content), self.groups[number].n_slots
                self.groups[number] = Group(scenario, n_slots // scenario.team.n_uavs, n_slots, self.features)
        if not isinstance(seeds, list) or [len(row) for row in seeds] != [group.world.n_envs for group in self.groups]:
            raise InputError("state: is that of an environment with other worlds")
        self._reset_seeds()
        start = 0
        for group, row in zip(self.groups, seeds, strict=True):
            for env, seed in enumerate(row):
                self._seeds[start + env * group.world.n_uavs] = check_seed(seed)
            start += group.n_slots


def _check_count(n_worlds: Any, least: int) -> None:
    if isinstance(n_worlds, bool) or not isinstance(n_worlds, int | np.integer) or n_worlds < least:
        raise InputError(f"n_worlds = {n_worlds!r}: must be an integer, at least 1 for each of {least} scenarios")


def _fixed_plans(scenarios: Any, n_worlds: int) -> list[tuple[Scenario, int, int]]:
    """Scenario, number of worlds and number of slots of each group."""
    several = [scenarios] if isinstance(scenarios, str | Scenario) else list(scenarios)
    if not several:
        raise InputError("scenarios: must name at least one")
    loaded = [load_scenario(scenario) for scenario in several]
    _check_count(n_worlds, len(loaded))
    counts = [int(n_worlds) // len(loaded) + (k < n_worlds % len(loaded)) for k in range(len(loaded))]
    return [(scenario, count, count * scenario.team.n_uavs) for scenario, count in zip(loaded, counts, strict=True)]
