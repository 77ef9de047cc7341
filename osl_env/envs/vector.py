"""Gymnasium's `VectorEnv` on the batch itself: one kernel call for all worlds, no loop over environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from osl_env.envs.single import team_action_space
from osl_env.envs.spaces import ActionTranslator, action_array, flat_space
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import SUCCESS, BoolArray, IntArray
from osl_env.streams import check_seed, entropy_seed, following_seeds
from osl_env.world import World


class TeamVectorEnv(VectorEnv[NDArray[np.float32], Any, NDArray[Any]]):
    """`num_envs` teams: sub-environment i behaves exactly as a `TeamEnv`, whatever the number of worlds.

    Autoreset is NEXT_STEP (an ended world begins anew with the next step, which ignores its action and gives reward
    0), SAME_STEP (it begins anew at once; the last observation is in `infos["final_obs"]`) or DISABLED (use
    `options["reset_mask"]`). Each UAV's own rewards of the last step are in `uav_rewards` (num_envs, n_uavs).
    """

    def __init__(
        self, scenario: str | Scenario = "rate-100x60x30", num_envs: int = 1, *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP, max_episode_steps: int | None = None,
        render_mode: str | None = None, **overrides: Any,
    ) -> None:  # fmt: skip
        """`scenario` and `overrides` as for `load_scenario`; `max_episode_steps` limits each UAV's decisions."""
        if render_mode is not None:
            raise InputError(f"render_mode = {render_mode!r}: a vector environment is not rendered; use gym.make")
        if max_episode_steps is not None:
            overrides = {**overrides, "ending.max_decisions": max_episode_steps}
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError:
            allowed = ", ".join(member.value for member in AutoresetMode)
            raise InputError(f"autoreset_mode = {autoreset_mode!r}: must be one of {allowed}") from None
        self.scenario = load_scenario(scenario, **overrides)
        self.world = World(self.scenario, num_envs)
        self.num_envs = self.world.n_envs
        self.metadata = {"autoreset_mode": mode, "render_modes": []}
        self._mode = mode
        self._translator = ActionTranslator(self.world)
        self.single_action_space = team_action_space(self._translator)
        self.single_observation_space = flat_space(self.world.layout.flat_size * self.world.n_uavs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self._ended: BoolArray = np.zeros(self.num_envs, np.bool_)

    @property
    def uav_rewards(self) -> NDArray[np.float64]:
        """(num_envs, n_uavs): each UAV's own reward of the last step."""
        return self.world.rewards

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin all episodes, or those in `options["reset_mask"]` (num_envs,) bool.

        World i gets `seed` + i, or entry i of a list; without a seed, the episode that follows its last one.
        """
        mask: BoolArray = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise InputError(f"options['reset_mask']: must be {self.num_envs} booleans, at least one of them True")
        self.world.reset(self._seeds(seed), mask)
        self._ended[mask] = False
        self.closed = False
        return self._observations(), self._infos()

    def _seeds(self, seed: int | Sequence[int | None] | None) -> IntArray:
        seeds = self._following()
        if isinstance(seed, Sequence | np.ndarray):
            if len(seed) != self.num_envs:
                raise InputError(f"seed: a list must hold {self.num_envs} seeds, one for each world, not {len(seed)}")
            for i, entry in enumerate(seed):
                if entry is not None:
                    seeds[i] = check_seed(entry)
        elif seed is not None:
            check_seed(check_seed(seed) + self.num_envs - 1)
            seeds = seed + np.arange(self.num_envs, dtype=np.int64)
        return seeds

    def _following(self) -> IntArray:
        """The seeds of the next episode of every world."""
        seeds = following_seeds(self.world.episode["seed"])
        fresh = ~self.world.begun
        if fresh.any():
            seeds[fresh] = following_seeds(entropy_seed() // 2 + np.flatnonzero(fresh))
        return seeds

    def step(
        self, actions: Any
    ) -> tuple[NDArray[np.float32], NDArray[np.float64], BoolArray, BoolArray, dict[str, Any]]:
        """One decision of every team. Raises InputError if the actions are not in the action space."""
        if not self.world.begun.all():
            raise InputError("step: call reset first")
        array = action_array(actions)
        if array.shape != self.action_space.shape:
            raise InputError(f"actions: must have the shape {self.action_space.shape}, not {array.shape}")
        restart = self._ended if self._mode is AutoresetMode.NEXT_STEP else None
        self._translator.step(array.reshape(self._translator.shape))
        team = self.world.team
        rewards, terminated, truncated = team["reward"].copy(), team["terminated"].copy(), team["truncated"].copy()
        if restart is not None and restart.any():
            self.world.reset(self._following(), restart)
            terminated &= ~restart
            truncated &= ~restart
            rewards[restart] = 0.0
        self._ended = terminated | truncated
        infos = {}
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            infos = self._restart(self._ended)
        return self._observations(), rewards, terminated, truncated, infos | self._infos()

    def _restart(self, ended: BoolArray) -> dict[str, Any]:
        """Begin the `ended` worlds anew; what they last showed, as Gymnasium's SAME_STEP gives it."""
        final: NDArray[Any] = np.full(self.num_envs, None, dtype=object)
        observations = self._observations()
        for i in np.flatnonzero(ended):
            final[i] = observations[i].copy()
        last = {name: np.where(ended, values, 0) for name, values in self._infos().items() if not name.startswith("_")}
        last |= {f"_{name}": ended.copy() for name in list(last)}
        self.world.reset(self._following(), ended)
        return {"final_obs": final, "_final_obs": ended.copy(), "final_info": last, "_final_info": ended.copy()}

    def _observations(self) -> NDArray[np.float32]:
        return self.world.layout.flat(self.world).reshape(self.num_envs, -1)

    def _infos(self) -> dict[str, Any]:
        episode = self.world.episode
        return {
            "clock": episode["clock"].copy(),
            "_clock": np.ones(self.num_envs, np.bool_),
            "success": episode["outcome"] == SUCCESS,
            "_success": np.ones(self.num_envs, np.bool_),
        }

    def action_masks(self) -> NDArray[np.bool_]:
        """Which hops end inside the area: (num_envs, n_uavs, n_actions) bool."""
        return self._translator.masks()


def make_vec(scenario: str | Scenario = "rate-100x60x30", n_envs: int = 1, **arguments: Any) -> TeamVectorEnv:
    """A native Gymnasium vector environment of `n_envs` teams in `scenario`; `arguments` as for `TeamVectorEnv`."""
    return TeamVectorEnv(scenario, n_envs, **arguments)


def solo_vector_env(scenario: str | Scenario = "rate-100x60x30", num_envs: int = 1, **arguments: Any) -> TeamVectorEnv:
    """The vector environment of `osl_env/Solo-v0`: one UAV alone in each world."""
    return TeamVectorEnv(scenario, num_envs, **{**arguments, "team.n_uavs": 1})
