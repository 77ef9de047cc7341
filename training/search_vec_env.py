"""SB3's VecEnv of the agent that moves the levers of a scoring rule: one slot a world, `MACRO_BEATS` legs a step.

What is learned is a whole team's manner of searching over half a minute, so noise in an action persists long enough to
have an effect; single choices among dozens of goals are too many for their small effects to be told from luck. Reward:
minus the time that passes, in minutes; if the search fails, minus all the time that was left, too. The return is minus
the capped search time, the leaderboard's own figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from baselines import Briefing
from baselines.search_agent.crew import Crew, SearchView
from baselines.search_agent.levers import MACRO_BEATS, N_LEVERS, N_SITUATION
from osl_env.parameters import FloatArray
from osl_env.scenario import Scenario
from osl_env.state import BoolArray, IntArray
from osl_env.streams import following_seeds
from osl_env.world import World

_MINUTE = 60.0  # s
_NOTHING: dict[str, Any] = {}  # shared by all slots where nothing ended


class SearchGroup:
    """Worlds of one scenario, side by side, with their crews."""

    def __init__(self, scenario: Scenario, n_worlds: int, view: SearchView, certainty: float) -> None:
        """`certainty`: mass within the success radius at which the mean is declared. Call `begin` first."""
        self.world = World(scenario.override(action="waypoint", reward={"shaping": 0.0}), n_worlds)
        self.n_uavs, self._certainty = self.world.n_uavs, certainty
        briefing = Briefing.of(scenario, 0, 0, np.zeros(3))
        self.crew = Crew(view, briefing, n_worlds)
        self._limit = scenario.ending.time_limit
        self.seeds: IntArray = np.zeros(n_worlds, np.int64)  # of the next episodes
        self._owed = np.zeros(n_worlds)
        self._radius = scenario.ending.success_radius
        self._clock = np.zeros(n_worlds)
        self.times, self.successes = np.empty(0), np.empty(0, np.bool_)  # of the episodes that have just ended

    def begin(self, seed: int) -> None:
        """Begin all worlds anew, their episodes derived from `seed` on."""
        self._owed[:] = 0.0
        self.seeds[:] = following_seeds(seed + np.arange(self.world.n_envs, dtype=np.int64))
        self.reset(np.ones(self.world.n_envs, np.bool_))

    def reset(self, mask: BoolArray) -> None:
        """Begin new episodes in the worlds of `mask`."""
        rows = np.flatnonzero(mask)
        self.world.reset(self.seeds, mask)
        self.seeds[rows] = following_seeds(self.seeds[rows])
        self.crew.reset(rows, self.world.motion["position"][rows])
        self._clock[rows] = self.world.episode["clock"][rows]
        self._sense(rows)

    def _sense(self, rows: Any = slice(None)) -> None:
        """Readings of the last beat into the beliefs of the worlds `rows`."""
        senses = self.world.senses[rows]
        self.crew.measure_wind(senses["wind"][:, 0], rows)
        positions = np.ascontiguousarray(self.world.motion["position"][rows])
        hits, seconds = senses["reading"].astype(np.float64), np.ascontiguousarray(senses["sampling_time"])
        self.crew.take(positions, hits, seconds, self.world.episode["clock"][rows], rows)

    def step(self, levers: NDArray[Any]) -> tuple[FloatArray, BoolArray]:
        """`MACRO_BEATS` beats with `levers` (n_worlds, N_LEVERS): rewards and done (n_worlds,).

        A world whose episode ends goes on with the next one under the same levers; what that costs is paid with the
        next step.
        """
        self.crew.set_levers(levers)
        rewards, done = self._owed.copy(), np.zeros(self.world.n_envs, np.bool_)
        self._owed[:] = 0.0
        for _ in range(MACRO_BEATS):
            beat, ended = self.beat()
            np.add(rewards, beat, out=rewards, where=~done)
            np.add(self._owed, beat, out=self._owed, where=done)
            done |= ended
        return rewards, done

    def beat(self) -> tuple[FloatArray, BoolArray]:
        """Everyone chooses, and the worlds fly one leg: rewards and which episodes ended (n_worlds,)."""
        for turn in range(self.n_uavs):
            self.crew.decide(turn)
        mates = self.crew.mates
        samples = np.rint(mates["seconds"] / self.crew.settings["sample"][:, None]).astype(np.int64)
        self.world.step_waypoints(mates["place"].copy(), samples)
        self.crew.fly(self.world.motion["position"])
        self._sense()
        done, success = self._ended()
        clock = np.minimum(self.world.episode["clock"], self._limit)
        rewards = -(clock - self._clock) / _MINUTE
        self._clock[:] = clock
        failed = done & ~success
        rewards[failed] -= (self._limit - clock[failed]) / _MINUTE
        self.times, self.successes = clock[done], success[done]
        if done.any():
            self.reset(done)
        return rewards, done

    def _ended(self) -> tuple[BoolArray, BoolArray]:
        """Which episodes are over, and which of these are successes. A declaration is judged here, not by the world:
        worlds that go on must not be stepped for it.
        """
        certain = self.crew.certain(self._certainty) & self.world.running
        errors = np.linalg.norm(self.world.source_position - self.crew.situations["mean"][:, None], axis=-1).min(axis=1)
        return certain | ~self.world.running, certain & (errors <= self._radius)


class SearchVecEnv(VecEnv):
    """All groups as one SB3 VecEnv: Discrete(K) over the candidates, Box observations; slots in the groups' order."""

    def __init__(
        self,
        groups: Sequence[tuple[Scenario, int]],
        *,
        view: SearchView | None = None,
        certainty: float = 0.98,
        seed: int = 0,
    ) -> None:
        """`groups`: scenarios, and how many worlds of each; `view` and `certainty` as for `SearchGroup`."""
        self.groups = [
            SearchGroup(scenario, n_worlds, view or SearchView(), certainty) for scenario, n_worlds in groups
        ]
        ends = np.cumsum([group.world.n_envs for group in self.groups]).tolist()
        self._slots = [slice(end - group.world.n_envs, end) for group, end in zip(self.groups, ends, strict=True)]
        self.render_mode: str | None = None
        observations = spaces.Box(-np.inf, np.inf, (N_SITUATION,), np.float32)
        super().__init__(ends[-1], observations, spaces.Box(-1.0, 1.0, (N_LEVERS,), np.float32))
        self._actions = np.zeros((self.num_envs, N_LEVERS))
        self._returns, self._lengths = np.zeros(self.num_envs), np.zeros(self.num_envs, np.int64)
        self._first_seed = seed
        self.reset()

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """The episodes that begin with the next `reset` are drawn from `seed` on."""
        self._first_seed = self._first_seed if seed is None else seed
        return super().seed(self._first_seed)

    def reset(self) -> NDArray[np.float32]:
        """Begin anew, with the first episodes from the seed."""
        for k, group in enumerate(self.groups):
            group.begin(self._first_seed + (k << 32))
        self._returns[:], self._lengths[:] = 0.0, 0
        self._reset_seeds()
        return self._observations()

    def _observations(self) -> NDArray[np.float32]:
        out = np.empty((self.num_envs, N_SITUATION), np.float32)
        for group, slots in zip(self.groups, self._slots, strict=True):
            out[slots] = group.crew.describe()
        return out

    def step_async(self, actions: NDArray[Any]) -> None:
        """Note the levers (num_envs, N_LEVERS)."""
        self._actions = np.asarray(actions, dtype=np.float64)

    def step_wait(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """`MACRO_BEATS` beats in every world."""
        rewards, done = np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)
        for group, slots in zip(self.groups, self._slots, strict=True):
            rewards[slots], done[slots] = group.step(self._actions[slots])
        self._returns += rewards
        self._lengths += 1
        observations, infos = self._observations(), [_NOTHING] * self.num_envs
        for slot in np.flatnonzero(done):
            episode = {"r": float(self._returns[slot]), "l": int(self._lengths[slot]), "t": 0.0}
            infos[slot] = {"episode": episode, "TimeLimit.truncated": False}
            self._returns[slot], self._lengths[slot] = 0.0, 0
        return observations, rewards.astype(np.float32), done, infos

    def close(self) -> None:
        """Nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of this environment, once a slot."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: slots share everything."""
        raise AttributeError(f"{attr_name}: worlds of a batch share their attributes; make another environment")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Call a method of this environment once; its result for every slot."""
        return [getattr(self, method_name)(*args, **kwargs)] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Never."""
        return [False] * len(list(self._get_indices(indices)))
