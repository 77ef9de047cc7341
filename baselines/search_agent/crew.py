"""One crew's view of a search, batched: the exact belief that its readings make, its mates, and the rule's levers.

In training a crew is a whole team in one world (in radio contact, all would hold the same belief); in flight it is one
UAV's own view, with the mates that it hears. Both run through the same code, so what is learned is what flies.

A beat is one leg of all. In it the UAVs choose in the order of their numbers, each knowing what those before it have
chosen (`decide(turn)`). In flight a UAV works out its lower-numbered mates' choices itself.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.belief import grid_kernels
from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import hit_model
from baselines.policy import Briefing
from baselines.search_agent.candidates import KINDS, N_CANDIDATES, OFFSETS
from baselines.search_agent.levers import (
    MACRO_BEATS,
    N_LEVERS,
    N_SITUATION,
    SEARCH_LEVERS,
    SITUATION_FEATURES,
    TIMES,
    TRACE_LEVERS,
    WEIGHT_SCALE,
    describe,
    set_levers,
)
from baselines.search_agent.sight import FEATURES, N_FEATURES, decide
from baselines.search_agent.state import MATE, SETTING, SITUATION
from baselines.search_agent.support import draw_support, summarise
from osl_env.parameters import FloatArray, Parameters, quantity

_MOST_CELLS = 24_000


class SearchView(Parameters):
    """What a crew computes with: part of the definition of the agent's observation."""

    leg_time: float = quantity(6.0, "s", gt=0)  # of every leg: turn, flight, and samples for the rest
    horizon: float = quantity(60.0, "s", gt=0)  # while there is no trace: way and sampling that goals are compared for
    dwell: float = quantity(6.0, "s", gt=0)  # on a trace: sampling that goals are compared for
    entropy_weight: float = quantity(50.0, "m", gt=0)  # metres of distance that a nat is worth, in the reference
    stand: float = quantity(30.0, "s", ge=0)  # while there is no trace: how long a UAV samples where it went
    patience: float = quantity(100.0, "s", gt=0)  # without a detection, then the trace is lost ..
    lost_spread: float = quantity(8.0, "m", gt=0)  # .. if the belief is spread out more than this
    cell: float = quantity(2.5, "m", gt=0)  # side of the belief's cells; larger in areas of over 24 000 of them
    places: int = quantity(256, "", ge=8, le=65_536, multiple_of=8)  # that expectations are taken over


def definition_hash(view: SearchView) -> str:
    """12 hexadecimal digits that change with anything that changes what a network sees, or what its choices mean."""
    names = [FEATURES, SITUATION_FEATURES, TRACE_LEVERS, SEARCH_LEVERS, TIMES, MACRO_BEATS, WEIGHT_SCALE]
    content = [view.model_dump(mode="json"), *names, OFFSETS.tolist(), KINDS.tolist()]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:12]


class Crew:
    """`n_crews` views of teams of `briefing.n_uavs` UAVs (the briefing gives area, plume, vehicle and sensor)."""

    def __init__(self, view: SearchView, briefing: Briefing, n_crews: int = 1) -> None:
        """Allocate; call `reset` before anything else."""
        self._briefing, self._view = briefing, view
        volume = float(np.prod(briefing.area))
        cell = max(view.cell, (volume / _MOST_CELLS) ** (1.0 / 3.0))
        self.belief = GridBelief(briefing.area, cell=cell, n_beliefs=n_crews)
        self.mates = np.zeros((n_crews, briefing.n_uavs), MATE)
        self.situations = np.zeros(n_crews, SITUATION)
        self.features: FloatArray = np.zeros((n_crews, N_CANDIDATES, N_FEATURES))  # of the last choice's candidates
        self.weights: FloatArray = np.zeros((n_crews, 2, N_FEATURES))
        self._support: NDArray[np.float32] = np.zeros((n_crews, 3, view.places), np.float32)
        self._winds: FloatArray = np.full((n_crews, 2), np.nan)  # m/s: what the belief's models were made for
        self._measured: NDArray[np.int64] = np.zeros(n_crews, np.int64)
        setting = np.zeros(1, SETTING)
        setting["area"], setting["speed"], setting["turn_time"] = briefing.area, briefing.speed, briefing.turn_time
        setting["sample"], setting["leg_time"] = briefing.hover_time, view.leg_time
        setting["horizon"], setting["stand"] = view.horizon, view.stand
        setting["dwell"], setting["entropy_weight"] = view.dwell, view.entropy_weight
        setting["most_samples"], setting["strength"] = briefing.max_samples, briefing.plume.source_strength
        self._setting, self.settings = setting, np.repeat(setting, n_crews)
        self.set_levers(np.zeros((n_crews, N_LEVERS)))

    def reset(self, rows: NDArray[np.int64], starts: FloatArray) -> None:
        """Begin the searches `rows` (n,) at `starts` (n, n_uavs, 3), m."""
        self.belief.reset(rows)
        self.mates[rows] = np.zeros(1, MATE)
        self.mates["position"][rows] = starts
        self.mates["goal"][rows] = starts
        self.mates["place"][rows] = starts
        self.mates["known"][rows] = True
        self.situations[rows] = np.zeros(1, SITUATION)
        self._measured[rows] = 0
        self._winds[rows] = np.nan

    def measure_wind(self, winds: FloatArray, rows: Any = slice(None)) -> None:
        """Take in one more measurement of the wind, (n, 3) m/s, in the crews `rows`: the mean of all is what counts."""
        self._measured[rows] += 1
        mean = self.situations["wind"][rows]
        step = (winds[:, :2] - mean[:, :2]) / self._measured[rows][:, None]
        mean[:, :2] += np.where(winds[:, :2] != mean[:, :2], step, 0.0)
        self.situations["wind"][rows] = mean
        for row in np.flatnonzero((self.situations["wind"][:, :2] != self._winds).any(axis=1)):
            wind = self.situations["wind"][row]
            self.belief.use_model(hit_model(self._briefing.plume, self._briefing.gas_sensor, wind), row)
            self._winds[row] = wind[:2]

    def take(
        self, positions: FloatArray, hits: FloatArray, seconds: FloatArray, clock: FloatArray, rows: Any = slice(None)
    ) -> None:
        """Condition the crews `rows` on M readings each: positions (n, M, 3) m, hits and seconds (n, M); clock (n,) s.

        A reading of 0 s says nothing. A new beat begins: nobody has chosen.
        """
        b, n = self.belief, len(clock)
        log_posterior, probability = b.log_posterior[rows], b.probability[rows]
        models = np.ascontiguousarray(b.models[rows])
        grid_kernels.update(log_posterior, probability, b.x, b.y, b.z, positions, hits, seconds, models)
        mean, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
        grid_kernels.moments(probability, b.x, b.y, b.z, mean, covariance)
        covariance[:, (0, 1, 2), (0, 1, 2)] += b.cell_variance
        certainty, entropy = np.empty(n), np.empty(n)
        summarise(probability, log_posterior, b.x, b.y, b.z, mean, self._briefing.success_radius, certainty, entropy)
        support = self._support[rows]
        draw_support(probability, b.x, b.y, b.z, b.size, support)
        if not isinstance(rows, slice):  # copies
            b.log_posterior[rows], b.probability[rows], self._support[rows] = log_posterior, probability, support
        team_hits = np.where(seconds > 0.0, hits, 0.0).sum(axis=1)
        s = self.situations
        s["mean"][rows], s["covariance"][rows] = mean, covariance
        s["entropy"][rows], s["certainty"][rows] = entropy, certainty
        s["clock"][rows], s["last_hits"][rows] = clock, team_hits
        s["last_detection"][rows] = np.where(team_hits > 0.0, clock, s["last_detection"][rows])
        s["heard"][rows] |= team_hits > 0.0
        spread = np.sqrt(covariance[:, (0, 1, 2), (0, 1, 2)].sum(axis=1))
        silent = clock - s["last_detection"][rows] > self._view.patience
        s["searching"][rows] = ~s["heard"][rows] | (silent & (spread > self._view.lost_spread))
        s["decision"][rows] += 1
        self.mates["planned"][rows] = False

    def describe(self) -> NDArray[np.float32]:
        """The situation of each crew, for the network: (n_crews, N_SITUATION)."""
        out = np.empty((len(self.situations), N_SITUATION), np.float32)
        describe(self.situations, self.mates, self.settings, self.belief.models, out)
        return out

    def set_levers(self, levers: NDArray[Any], rows: Any = slice(None)) -> None:
        """What the network has said, (n, N_LEVERS) in [-1, 1], is the rule of the crews `rows` from now on."""
        set_levers(levers, self._setting, self.settings, self.weights, rows)

    def decide(self, turn: int) -> None:
        """UAV `turn` of each crew chooses its goal and its leg of this beat: `mates` (goal, place, seconds)."""
        decide(self.situations, self.mates, self.settings, self.belief.models, self._support, self.weights, turn,
               self.features)  # fmt: skip

    def support(self, row: int) -> FloatArray:
        """(P, 3) m: equally likely places of the belief of crew `row`."""
        return np.asarray(self._support[row].T, dtype=np.float64)

    def certain(self, threshold: float) -> NDArray[np.bool_]:
        """(n_crews,): something was detected, and the mean is right with a probability of at least `threshold`."""
        certain: NDArray[np.bool_] = self.situations["heard"] & (self.situations["certainty"] >= threshold)
        return certain

    def fly(self, positions: FloatArray) -> None:
        """The beat is over: mates are at `positions` (n_crews, n_uavs, 3), m; headings follow from the way there."""
        way = positions - self.mates["position"]
        length = np.sqrt((way * way).sum(axis=-1))
        moved = length > 1e-6
        self.mates["heading"][moved] = way[moved] / length[moved][:, None]
        self.mates["position"] = positions
