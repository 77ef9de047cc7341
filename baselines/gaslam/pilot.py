"""One UAV's flight by GaSLAM: every reading goes into the maps; at a goal the source is estimated and the next chosen.

Goals last at least `goal_time`: as printed, (8) can put one where the UAV is, and each estimate costs milliseconds. A
goal counts as reached within `arrival_radius`, or when the UAV gets no nearer to it. A cell towards which it gave up is
no target again, and those in obstacles are none: nothing would ever be measured there.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from baselines.gaslam.budget import Budget
from baselines.gaslam.declaration import Guesses
from baselines.gaslam.flying import Flying
from baselines.gaslam.mapping import Mapping, length_scale
from baselines.gaslam.navigation import Differences, cell_to_explore, divergence, goal
from baselines.passage import Passage
from baselines.policy import Briefing
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray

if TYPE_CHECKING:
    from baselines.gaslam.policy import GaSLAM

Mode: TypeAlias = Literal["explore", "exploit", "record"]


class Pilot:
    """One UAV's state of an episode."""

    __slots__ = (
        "_beyond",
        "_budget",
        "_differences",
        "_distance",
        "_flying",
        "_goal_until",
        "_guesses",
        "_open",
        "_parameters",
        "_rng",
        "_target",
        "bits",
        "declared",
        "mapping",
        "mode",
    )

    def __init__(self, parameters: GaSLAM, briefing: Briefing) -> None:
        """Raises InputError for cells that the area cannot have."""
        p = self._parameters = parameters
        self.mapping = Mapping(p, briefing)
        scale = length_scale(briefing, p)
        self._distance, radius = scale * p.goal_distance, scale * p.arrival_radius
        self._beyond = briefing.action != "leg"
        self._flying = Flying(briefing, radius, p.samples)
        self._budget, self._guesses = Budget(briefing), Guesses(p)
        self._differences = Differences(p, self.mapping.cells.n)
        self._open = Passage(briefing).free(self.mapping.cells.centres)  # (n,) cells that can be targets
        self._target = 0  # the cell that decides the present goal
        self._goal_until = -math.inf  # s: the goal is kept so long at least
        self._rng = np.random.default_rng(briefing.seed)
        self.mode: Mode = "explore"
        self.declared: FloatArray | None = None  # (3,) m
        self.bits = 0.0

    def act(self, observation: Observation) -> Action:
        """Take in what is new, choose a goal where the last is reached, and fly there."""
        self.mapping.take(observation)
        self._budget.take(observation)
        x, y, z = observation.position.tolist()
        position = (x, y, z)
        self.bits = 0.0
        if self._goal_until < 0.0 or (observation.time >= self._goal_until and self._flying.arrived(position)):
            if self._goal_until >= 0.0 and self._flying.gave_up(position):
                self._open[self._target] = False
            x, y, z = self._next_goal(observation).tolist()
            self._flying.aim((x, y, z))
            self._goal_until = observation.time + self._parameters.goal_time
        target = self._flying.target(observation, position)
        if self._budget.ends(observation, self._flying.duration(position, target)):
            self.declared = self._verdict()
        return self._flying.command(observation, position, target)

    def _next_goal(self, observation: Observation) -> FloatArray:
        """Estimate the source, and choose between exploring and exploiting: (3,) m (4)."""
        p, m, here = self._parameters, self.mapping, observation.position
        self.bits = m.estimate(self._rng)
        if m.posterior is not None:
            self._guesses.take(m.guess, m.posterior.entropy, m.alpha)
        explored, exploited = self._cell_to_explore(here), self._exploit()
        self._target = explored if m.alpha < 0.5 else m.cells.nearest(exploited)
        self.mode = "record" if self._guesses.recording else "explore" if m.alpha == 0.0 else "exploit"
        place = goal(p, here, m.cells.centres[explored], exploited, m.alpha, self._distance, self._beyond)
        return np.clip(place, m.cells.low, m.cells.high)

    def _cell_to_explore(self, here: FloatArray) -> int:
        p, m, kernel = self._parameters, self.mapping, self.mapping.kernel
        bits = divergence(p, kernel.reading_cells, kernel.readings, kernel.mean, kernel.variance)
        if self._open.any():
            bits = np.where(self._open, bits, 0.0)
        return cell_to_explore(p, bits, kernel.confidence, m.cells.centres, here, m.others)

    def _exploit(self) -> FloatArray:
        """The target of (8), (3,) m."""
        m, guesses = self.mapping, self._guesses
        if m.posterior is not None and guesses.recording and guesses.low(m.posterior.entropy):
            cell = self._differences.next_cell(m.kernel.mean, m.plume, m.kernel_gas & m.plume_gas & self._open)
            return m.guess if cell is None else m.cells.centres[cell]
        return m.guess

    def _verdict(self) -> FloatArray | None:
        """What to declare: the voted source, else the last guess if any gas was found, else nothing: (3,) m."""
        m = self.mapping
        voted = self._guesses.vote(m.bins)
        if voted is None and m.posterior is not None and m.kernel_gas.any():
            voted = m.guess
        return None if voted is None else np.clip(voted, m.cells.low, m.cells.high)
