"""`UavVecEnv` for agents whose actions and observations are relative to the wind (`baselines.learned.course`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from baselines.features import DEFAULT_FEATURES, FeatureSpec
from baselines.learned.course import Course, WindFrame
from osl_env.envs.spaces import action_array
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import BoolArray
from training.sb3_vec_env import UavVecEnv


class CourseVecEnv(UavVecEnv):
    """The worlds of `UavVecEnv`, flown in legs relative to the wind: Discrete(course.n_actions)."""

    def __init__(
        self,
        scenarios: str | Scenario | Sequence[str | Scenario],
        n_worlds: int,
        features: FeatureSpec = DEFAULT_FEATURES,
        seed: int = 0,
        course: Course | None = None,
    ) -> None:
        """See `UavVecEnv`; the scenarios' own `action` does not matter. Raises InputError without the feature raw."""
        several = [scenarios] if isinstance(scenarios, str | Scenario) else list(scenarios)
        super().__init__([load_scenario(scenario, action="waypoint") for scenario in several], n_worlds, features, seed)
        self.course, self._frame = course or Course(), WindFrame(self.features)
        self.action_space = spaces.Discrete(self.course.n_actions)

    def reset(self) -> NDArray[np.float32]:
        """Begin all worlds anew (see `UavVecEnv.reset`)."""
        return self._frame.turned(super().reset())

    def step_async(self, actions: Any) -> None:
        """Take `actions` (num_envs,) for `step_wait`. Raises InputError if they are not of that shape, or unknown."""
        array = action_array(actions)
        if array.shape != (self.num_envs,) or array.dtype.kind not in "iu":
            raise InputError(f"actions: must be {self.num_envs} integers, not {array.dtype} of shape {array.shape}")
        if array.min() < 0 or array.max() >= self.course.n_actions:
            raise InputError(f"actions: must be from 0 to {self.course.n_actions - 1}")
        boxes, start = np.full((self.num_envs, 5), -1.0), 0
        for group in self.groups:
            own = slice(start, start + group.used)
            motion, senses = group.world.motion.reshape(-1), group.world.senses.reshape(-1)
            boxes[own] = self.course.boxes(
                array[own], motion["position"], senses["wind"], senses["reading"],
                np.array(group.scenario.arena.size), group.scenario.vehicle.max_samples,
            )  # fmt: skip
            start += group.n_slots
        super().step_async(boxes)

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], BoolArray, list[dict[str, Any]]]:
        """One decision of every UAV (see `UavVecEnv.step_wait`)."""
        observations, rewards, dones, infos = super().step_wait()
        for slot in np.flatnonzero(dones).tolist():
            infos[slot]["terminal_observation"] = self._frame.turned(infos[slot]["terminal_observation"][None])[0]
        return self._frame.turned(observations), rewards, dones, infos
