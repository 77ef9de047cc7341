"""PettingZoo view: a `ParallelEnv` in which every UAV is an agent."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec

from osl_env.envs.render import TrackRecorder
from osl_env.envs.spaces import ActionTranslator, flat_space, next_seed, physical_dict, physical_space
from osl_env.errors import InputError
from osl_env.scenario import Scenario
from osl_env.scenario_files import load_scenario
from osl_env.state import SUCCESS
from osl_env.world import World


class OdourSearchParallelEnv(ParallelEnv[str, Any, Any]):  # type: ignore[misc]
    """Agents `uav_0`, `uav_1`, ..: observations and actions as tabulated in the README.

    `observation="flat"` gives normalised float32 vectors for learning, `"physical"` a Dict of named quantities in SI
    units. An agent whose battery is empty, or whose UAV is lost, terminates; one whose time or decisions are used up is
    truncated; a declaration (or, under the rule `reach`, an arrival) terminates all that are left.
    """

    metadata = {"name": "osl_env_v0", "render_modes": ["rgb_array"], "is_parallelizable": True, "render_fps": 4}  # noqa: RUF012

    def __init__(
        self, scenario: str | Scenario, *, render_mode: str | None = None, observation: str = "flat",
        max_cycles: int | None = None, **overrides: Any,
    ) -> None:  # fmt: skip
        """`scenario`: a preset's name, a YAML file or a Scenario, with `overrides` (see `load_scenario`).

        `max_cycles` limits each UAV's decisions. Raises InputError for anything unknown.
        """
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode = {render_mode!r}: must be None or 'rgb_array'")
        if observation not in ("flat", "physical"):
            raise InputError(f"observation = {observation!r}: must be 'flat' or 'physical'")
        if max_cycles is not None:
            overrides = {**overrides, "ending.max_decisions": max_cycles}
        self.scenario = load_scenario(scenario, **overrides)
        self.render_mode = render_mode
        self.world = World(self.scenario, 1)
        self._translator = ActionTranslator(self.world)
        self._physical = observation == "physical"
        self.possible_agents = [f"uav_{i}" for i in range(self.world.n_uavs)]
        self.agents: list[str] = []
        self._area = np.array(self.scenario.arena.size)
        layout = self.world.layout
        space = physical_space(layout) if self._physical else flat_space(layout.flat_size)
        self._spaces = dict.fromkeys(self.possible_agents, space)
        self._action_spaces = {agent: type_copy(self._translator.space) for agent in self.possible_agents}
        self.observation_spaces, self.action_spaces = self._spaces, self._action_spaces
        self.state_space = flat_space(layout.flat_size * self.world.n_uavs)
        box = self._translator.shape[2:]
        self._actions: NDArray[Any] = np.zeros(self._translator.shape, np.float64 if box else np.int64)
        self._index = {agent: i for i, agent in enumerate(self.possible_agents)}
        world = self.world  # views of what every step reads, made once
        self._view = {name: world.motion[name][0] for name in ("active", "terminated", "truncated")}
        self._view |= {name: world.ledger[name][0] for name in ("search_time", "spent")}
        self._view |= {name: world.episode[name] for name in ("clock", "outcome")} | {"rewards": world.rewards[0]}
        self._recorder: TrackRecorder | None = None

    @property
    def max_cycles(self) -> int:
        """The most decisions of each UAV; may be set."""
        return int(self.world.constants["max_decisions"][0])

    @max_cycles.setter
    def max_cycles(self, value: int) -> None:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
            raise InputError(f"max_cycles = {value!r}: must be an integer of at least 1")
        self.world.constants["max_decisions"][0] = value

    @functools.cache  # noqa: B019 - PettingZoo wants the identical object each time
    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The observation space of `agent`."""
        return self._spaces[agent]

    @functools.cache  # noqa: B019
    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The action space of `agent`."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode: the one of `seed`, or the one that follows the last. Observations and infos by agent."""
        self.world.reset([next_seed(self.world, seed)])
        self.agents = self.possible_agents.copy()
        if self.render_mode is not None:
            self._recorder = TrackRecorder(self.world)
        return self._observations(self.agents), self._infos(self.agents)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One decision of every live agent. Raises InputError if one is missing or its action is not in its space."""
        live = self.agents
        if not live:
            raise InputError("step: no agent is alive; call reset first")
        if self._translator.mode == "hop":
            self._read_hops(actions)
            self.world.step_hops(self._actions)
        else:
            self._read_boxes(actions)
            self._translator.step(self._actions)
        if self._recorder is not None:
            self._recorder.record()
        view, index = self._view, self._index
        rewards, active = view["rewards"].tolist(), view["active"].tolist()
        terminated, truncated = view["terminated"].tolist(), view["truncated"].tolist()
        self.agents = [agent for agent in live if active[index[agent]]]
        return (
            self._observations(live),
            {agent: rewards[index[agent]] for agent in live},
            {agent: terminated[index[agent]] for agent in live},
            {agent: truncated[index[agent]] for agent in live},
            self._infos(live),
        )

    def _read_hops(self, actions: dict[str, Any]) -> None:
        row, limit = self._actions[0], self._translator.n_actions
        for agent in self.agents:
            action = _of(actions, agent)
            if type(action) is not int and type(action) is not np.int64:
                if isinstance(action, bool) or np.shape(action) != () or np.asarray(action).dtype.kind not in "iu":
                    raise InputError(f"actions[{agent!r}] = {action!r}: must be an integer from 0 to {limit - 1}")
                action = int(action)
            if not 0 <= action < limit:
                raise InputError(f"actions[{agent!r}] = {action}: must be from 0 to {limit - 1}")
            row[self._index[agent]] = action

    def _read_boxes(self, actions: dict[str, Any]) -> None:
        shape = self._translator.shape[2:]
        for agent in self.agents:
            action = np.asarray(_of(actions, agent))
            if action.shape != shape or action.dtype.kind != "f":
                raise InputError(
                    f"actions[{agent!r}]: must be floating point numbers of shape {shape},"
                    f" not {action.dtype} of shape {action.shape}"
                )
            if not (np.abs(action) <= 1.0).all():
                raise InputError(f"actions[{agent!r}] = {action.tolist()}: must be finite and from -1 to 1")
            self._actions[0, self._index[agent]] = action

    def _observations(self, agents: list[str]) -> dict[str, Any]:
        index = self._index
        if self._physical:
            world = self.world
            return {agent: physical_dict(world.observation(0, index[agent]), self._area) for agent in agents}
        flat = self.world.layout.flat(self.world)[0]
        return {agent: flat[index[agent]] for agent in agents}

    def _infos(self, agents: list[str]) -> dict[str, dict[str, Any]]:
        """Numbers with the same keys always: mission clock, own search time, energy spent, and whether the team
        succeeded.
        """
        view, index = self._view, self._index
        clock, success = view["clock"].item(), view["outcome"].item() == SUCCESS
        times, spent = view["search_time"].tolist(), view["spent"].tolist()
        return {
            agent: {"clock": clock, "search_time": times[i], "energy": spent[i], "success": success}
            for agent, i in ((agent, index[agent]) for agent in agents)
        }

    def action_mask(self, agent: str) -> NDArray[np.int8]:
        """Which hops of `agent` end inside the area (n_actions,) int8, as `Discrete.sample(mask=..)` takes it."""
        mask: NDArray[np.int8] = self._translator.masks()[0, self._index[agent]].astype(np.int8)
        return mask

    def state(self) -> NDArray[np.float32]:
        """Global state for central critics: all UAVs' normalised observations in a row. No source position."""
        state: NDArray[np.float32] = self.world.layout.flat(self.world).reshape(-1)
        return state

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as an RGB image (height, width, 3) uint8, with the tracks so far; None without a render mode."""
        return None if self._recorder is None else self._recorder.draw()

    def close(self) -> None:
        """Nothing to release; may be called again and again."""


def _of(actions: Any, agent: str) -> Any:
    try:
        return actions[agent]
    except (KeyError, TypeError):
        raise InputError(f"actions: there is none for {agent!r}") from None


def type_copy(space: spaces.Space[Any]) -> spaces.Space[Any]:
    """A space of the same kind with a generator of its own, so that agents' samples do not depend on each other."""
    if isinstance(space, spaces.Discrete):
        return spaces.Discrete(int(space.n))
    assert isinstance(space, spaces.Box)
    return spaces.Box(space.low, space.high, dtype=np.float32)


def parallel_env(
    scenario: str | Scenario = "rate-100x60x30", *, render_mode: str | None = None, **arguments: Any
) -> OdourSearchParallelEnv:
    """The PettingZoo parallel environment of `scenario`; `arguments` as for `OdourSearchParallelEnv`."""
    return OdourSearchParallelEnv(scenario, render_mode=render_mode, **arguments)


def env(
    scenario: str | Scenario = "rate-100x60x30", *, render_mode: str | None = None, **arguments: Any
) -> AECEnv[str, Any, Any]:
    """The same environment for PettingZoo's agent-by-agent API."""
    return parallel_to_aec(parallel_env(scenario, render_mode=render_mode, **arguments))
