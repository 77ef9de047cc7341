"""Faults of UAVs, as events of a scenario: a sensor dies, a radio is lost, a UAV is lost, at a time or at a rate.

    dead_sensor   the gas sensor reads 0 from then on: no detections
    lost_radio    the radio neither sends (no bytes, no energy) nor hears; what was heard before stays known, and ages
    lost_uav      the flight ends; what it has sent stays known

A rule strikes one UAV, so many of them (`number`, drawn anew for each episode), or all; at a `time` of the mission
clock, or each at a time of its own with a constant hazard `rate`, P(T > t) = exp(-rate t). A fault shows where a UAV's
leg or decision period ends, so on legs it waits for the end of the leg under way; a UAV is lost at the end of its first
leg or period at the earliest, and it neither samples nor sends there. Policies are told nothing.

Every UAV has a stream of its own for each kind: its first draw says its place in the order in which UAVs are struck,
its second its time. So those of `number: 2` are among those of `number: 3`, and wind, plume, sensors and radio are the
same with and without faults (a dead sensor goes on drawing; where rotors stir the plume, a lost UAV no longer does).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from pydantic import model_validator

from osl_env.numerics import uniform
from osl_env.parameters import FloatArray, Parameters, quantity
from osl_env.state import LOST, BoolArray, IntArray, StateArray
from osl_env.streams import Purpose, derive

FAULT_KINDS = ("dead_sensor", "lost_radio", "lost_uav")
_DEAD_SENSOR, _LOST_RADIO, _LOST_UAV = range(len(FAULT_KINDS))
_FAULT = int(Purpose.FAULT)
_STREAMS_OF_KIND = 4096  # more than there are UAVs
_SAME_TIME = 1e-6  # s: a clock is a sum of many rounded periods
_ANY = -1

_RULE = np.dtype(  # (n_kinds,)
    [
        ("uav", np.int64),  # -1: any
        ("number", np.int64),  # the first so many in the episode's order
        ("time", np.float64),  # s; inf: drawn at the rate
        ("rate", np.float64),  # 1/s
    ],
    align=True,
)


class FaultRule(Parameters):
    """Which UAVs a fault strikes, and when. With neither time nor rate it is there from the beginning."""

    uav: int | None = quantity(None, "", ge=0)  # its number
    number: int | None = quantity(None, "", ge=0)  # of UAVs, drawn anew for each episode; with no `uav` either: all
    time: float | None = quantity(None, "s", ge=0)  # mission clock
    rate: float | None = quantity(None, "1/s", ge=0)  # hazard of each of those UAVs

    @model_validator(mode="after")
    def _consistent(self) -> FaultRule:
        if self.uav is not None and self.number is not None:
            raise ValueError(f"number = {self.number}: goes without uav = {self.uav}; give one of them")
        if self.time is not None and self.rate is not None:
            raise ValueError(f"rate = {self.rate:g}: goes without time = {self.time:g}; give one of them")
        return self

    @property
    def strikes(self) -> bool:
        """Whether it can strike at all."""
        return self.number != 0 and self.rate != 0.0


class UavFaults(Parameters):
    """The faults of a scenario's UAVs: a rule for each kind, or none."""

    dead_sensor: FaultRule | None = None
    lost_radio: FaultRule | None = None
    lost_uav: FaultRule | None = None

    def check(self, n_uavs: int) -> None:
        """Raises ValueError if a rule strikes UAVs that a team of `n_uavs` does not have."""
        for kind in FAULT_KINDS:
            rule = getattr(self, kind)
            if rule is not None and rule.uav is not None and rule.uav >= n_uavs:
                raise ValueError(f"{kind}.uav = {rule.uav}: there are UAVs 0 to {n_uavs - 1}")
            if rule is not None and rule.number is not None and rule.number > n_uavs:
                raise ValueError(f"{kind}.number = {rule.number}: there are {n_uavs} UAVs")

    @property
    def rules(self) -> dict[str, FaultRule]:
        """The rules that can strike, by kind."""
        given = {kind: getattr(self, kind) for kind in FAULT_KINDS}
        return {kind: rule for kind, rule in given.items() if rule is not None and rule.strikes}

    @property
    def silence(self) -> bool:
        """Whether radios may fall silent: by themselves, or with their UAVs."""
        return not {"lost_radio", "lost_uav"}.isdisjoint(self.rules)

    def allocate(self, n_envs: int, n_uavs: int) -> FaultTimes | None:
        """State for `n_envs` worlds of `n_uavs`; None if no rule can strike."""
        return FaultTimes(self.rules, n_envs, n_uavs) if self.rules else None


@njit(cache=True, error_model="numpy")
def draw_fault_times(rules: StateArray, rows: IntArray, seeds: IntArray, times: FloatArray) -> None:
    """When UAVs are struck in the episodes with `seeds` in the worlds `rows`: s, into `times` (n_envs, n_uavs,
    n_kinds); inf: never. `rules` (n_kinds,) are _RULE.
    """
    n_uavs = times.shape[1]
    keys = np.empty(n_uavs)
    for k in range(rows.size):
        for kind in range(rules.size):
            rule = rules[kind]
            for i in range(n_uavs):
                stream, keys[i] = uniform(derive(seeds[k], _FAULT, kind * _STREAMS_OF_KIND + i))
                stream, u = uniform(stream)
                drawn = -math.log(1.0 - u) / rule.rate if rule.rate > 0.0 else math.inf
                times[rows[k], i, kind] = min(rule.time, drawn)
            for i in range(n_uavs):
                before = 0
                for j in range(n_uavs):
                    before += keys[j] < keys[i] or (keys[j] == keys[i] and j < i)
                if before >= rule.number or (rule.uav != _ANY and rule.uav != i):
                    times[rows[k], i, kind] = math.inf


@njit(cache=True, error_model="numpy")
def strike(
    motion: StateArray, senses: StateArray, episode: StateArray, stepping: BoolArray, times: FloatArray, flown: bool
) -> None:
    """Carry out the faults that are due, s, by `times` (n_envs, n_uavs, n_kinds), of UAVs whose leg or period ended.

    UAVs are lost only if they have `flown`: not at a reset.
    """
    for e in range(motion.shape[0]):
        if not stepping[e]:
            continue
        now = episode[e].clock + _SAME_TIME
        for i in range(motion.shape[1]):
            m = motion[e, i]
            if not (m.active and m.ready):
                continue
            senses[e, i].dead = now >= times[e, i, _DEAD_SENSOR]
            m.silent = now >= times[e, i, _LOST_RADIO]
            if flown and now >= times[e, i, _LOST_UAV]:
                m.fate = LOST
                m.active = m.truncated = False
                m.terminated = True
                m.velocity[:] = 0.0


class FaultTimes:
    """When the UAVs of a batch of worlds are struck: `times` (n_envs, n_uavs, n_kinds), s; inf: never."""

    def __init__(self, rules: dict[str, FaultRule], n_envs: int, n_uavs: int) -> None:
        """For `rules` by kind."""
        self.times: FloatArray = np.full((n_envs, n_uavs, len(FAULT_KINDS)), math.inf)
        self._rules: StateArray = np.zeros(len(FAULT_KINDS), _RULE)
        self._rules["time"] = math.inf
        for kind, rule in rules.items():
            row = self._rules[FAULT_KINDS.index(kind)]
            row["uav"] = _ANY if rule.uav is None else rule.uav
            row["number"] = n_uavs if rule.number is None else rule.number
            row["rate"] = rule.rate or 0.0
            row["time"] = math.inf if rule.rate is not None else rule.time or 0.0

    def begin(self, rows: IntArray, seeds: IntArray) -> None:
        """Draw the times of the episodes with `seeds` in the worlds `rows`."""
        draw_fault_times(self._rules, rows, seeds, self.times)

    def strike(
        self, motion: StateArray, senses: StateArray, episode: StateArray, stepping: BoolArray, *, flown: bool
    ) -> None:
        """See the function of this name."""
        strike(motion, senses, episode, stepping, self.times, flown)
