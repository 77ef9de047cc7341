"""Gymnasium views of one world: the whole team under central control (`Team-v0`), and one UAV alone (`Solo-v0`)."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from osl_env.envs.render import TrackRecorder
from osl_env.envs.spaces import ActionTranslator, action_array, flat_space, next_seed
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import SUCCESS
from osl_env.world import World


def team_action_space(translator: ActionTranslator) -> spaces.Space[Any]:
    """All UAVs' actions in a row; a lone UAV keeps its own space."""
    n_uavs = translator.world.n_uavs
    if isinstance(translator.space, spaces.Discrete):
        return translator.space if n_uavs == 1 else spaces.MultiDiscrete([int(translator.space.n)] * n_uavs)
    return spaces.Box(-1.0, 1.0, (translator.shape[-1] * n_uavs,), np.float32)


class TeamEnv(gym.Env[NDArray[np.float32], Any]):
    """One world; the action is that of all UAVs in a row, the reward their mean, the observation all of theirs in a
    row.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012

    def __init__(
        self, scenario: str | Scenario = "rate-100x60x30", *, render_mode: str | None = None, **overrides: Any
    ) -> None:
        """`scenario` and `overrides` as for `load_scenario`. Raises InputError for anything unknown."""
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode = {render_mode!r}: must be None or 'rgb_array'")
        self.scenario = load_scenario(scenario, **overrides)
        self.render_mode = render_mode
        self.world = World(self.scenario, 1)
        self._translator = ActionTranslator(self.world)
        self.action_space = team_action_space(self._translator)
        self.observation_space: spaces.Space[Any] = flat_space(self.world.layout.flat_size * self.world.n_uavs)
        self._recorder: TrackRecorder | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode: the one of `seed`, or the one that follows the last."""
        super().reset(seed=seed)
        self.world.reset([next_seed(self.world, seed)])
        if self.render_mode is not None:
            self._recorder = TrackRecorder(self.world)
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """One decision of the whole team. Raises InputError if the action is not in the action space."""
        if not self.world.running[0]:
            raise InputError("step: the episode is over or has not begun; call reset first")
        array = action_array(action)
        if array.shape != self.action_space.shape:
            raise InputError(f"action: must have the shape {self.action_space.shape}, not {array.shape}")
        self._translator.step(array.reshape(self._translator.shape))
        if self._recorder is not None:
            self._recorder.record()
        team = self.world.team[0]
        return (
            self._observation(),
            float(team["reward"]),
            bool(team["terminated"]),
            bool(team["truncated"]),
            self._info(),
        )

    def _observation(self) -> NDArray[np.float32]:
        flat: NDArray[np.float32] = self.world.layout.flat(self.world).reshape(-1)
        return flat

    def _info(self) -> dict[str, Any]:
        episode = self.world.episode[0]
        return {"clock": float(episode["clock"]), "success": bool(episode["outcome"] == SUCCESS)}

    def action_masks(self) -> NDArray[np.bool_]:
        """Which hops end inside the area, all UAVs in a row, as sb3-contrib's MaskablePPO asks for it."""
        masks: NDArray[np.bool_] = self._translator.masks().reshape(-1)
        return masks

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as an RGB image (height, width, 3) uint8, with the tracks so far; None without a render mode."""
        return None if self._recorder is None else self._recorder.draw()


class SoloEnv(TeamEnv):
    """One UAV alone in `scenario`: the team of the scenario is cut to its first UAV."""

    def __init__(
        self, scenario: str | Scenario = "rate-100x60x30", *, render_mode: str | None = None, **overrides: Any
    ) -> None:
        """As `TeamEnv`, with `team.n_uavs` = 1."""
        super().__init__(load_scenario(scenario, **overrides), render_mode=render_mode, **{"team.n_uavs": 1})
