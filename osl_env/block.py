"""The order of a step: the kernels that fly, read the plume, sample, talk, end and reward, on a World's state.

A block holds the arrays of a World, not copies of them. It takes all worlds at once: cutting the batch into pieces that
fit a processor's cache was measured to be slower (0.87 times at 1024 worlds, 0.94 times at 8192).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from osl_env.ending import any_declares, end_at_source, judge, own_places
from osl_env.energy import ThrustEnergy
from osl_env.faults import FaultTimes
from osl_env.flying import fly_hops, fly_periods, fly_waypoints
from osl_env.flying_bodies import fly_body_periods
from osl_env.flying_body_legs import fly_body_legs
from osl_env.flying_rotorpy import RotorpyFleet
from osl_env.geometry import Geometry
from osl_env.parameters import FloatArray
from osl_env.radio import ContactArray, send_in_range
from osl_env.reward import shape
from osl_env.scenario import Scenario
from osl_env.state import BoolArray, IntArray, StateArray
from osl_env.stepping import finish, settle
from osl_env.surroundings import Surroundings
from osl_env.vehicles.legs import hop_table
from osl_env.vehicles.quadrotor import Quadrotor


@dataclass(frozen=True, slots=True)
class Rules:
    """What does not change from step to step."""

    constants: StateArray
    geometry: Geometry | None  # None: no obstacles
    hop_table: FloatArray  # (26 l_max + 1, 8)
    sampling_time: float  # s
    talks: bool  # there is a radio
    to_all: bool  # and its frames reach everybody at once
    reaching: bool  # success is to reach a source
    shaping: bool  # the shaping term is on
    frames: StateArray | None  # AIRFRAME (1,) of quadrotors; None: the vehicles have no body
    rotorpy: RotorpyFleet | None  # flies them instead
    rotors: StateArray | None  # (1,): their power from thrust; None: powers are measured ones

    @classmethod
    def of(cls, scenario: Scenario, constants: StateArray) -> Rules:
        """The rules of `scenario`, whose `constants` are CONSTANTS (1,)."""
        vehicle = scenario.vehicle
        return cls(
            constants=constants,
            geometry=scenario.arena.geometry if scenario.arena.obstructed else None,
            hop_table=hop_table(vehicle),
            sampling_time=scenario.decision_time,
            talks=scenario.radio.radius > 0 and scenario.team.n_uavs > 1,
            to_all=scenario.hears_all,
            reaching=scenario.ending.success == "reach",
            shaping=scenario.reward.shaping > 0,
            frames=vehicle.numbers() if isinstance(vehicle, Quadrotor) else None,
            rotorpy=RotorpyFleet(vehicle) if isinstance(vehicle, Quadrotor) and vehicle.backend == "rotorpy" else None,
            rotors=scenario.energy.numbers() if isinstance(scenario.energy, ThrustEnergy) else None,
        )


@dataclass(frozen=True, slots=True)
class Block:
    """The state of all worlds; arrays as in `World`."""

    rules: Rules
    motion: StateArray
    positions: FloatArray  # those in `motion`
    ledger: StateArray
    senses: StateArray
    episode: StateArray
    sources: FloatArray
    strengths: FloatArray
    stepping: BoolArray
    rates: FloatArray
    surroundings: Surroundings
    rewards: FloatArray
    team: StateArray
    links: BoolArray
    heard: StateArray
    contacts: ContactArray
    sent: StateArray
    reach: BoolArray
    body: FloatArray  # (n_envs, n_uavs, 17), or empty
    faults: FaultTimes | None  # of UAVs; None: there are none

    def hop(self, actions: IntArray, cursor: int) -> None:
        """One step of hops; see `World.step_hops`."""
        b, rules = self, self.rules
        declaring = len(rules.hop_table)
        if any_declares(actions, declaring):
            declarations = np.empty((*b.motion.shape, 3))
            own_places(b.motion, actions, declaring, declarations)
            b.judge(declarations)
        fly_hops(b.motion, b.ledger, b.episode, rules.constants, rules.geometry, b.stepping, actions, rules.hop_table)
        b.settle(cursor, is_step=True)

    def fly_to(self, targets: FloatArray, samples: IntArray, declarations: FloatArray | None, cursor: int) -> None:
        """One step of legs; see `World.step_waypoints`."""
        b, rules = self, self.rules
        b.judge(declarations)
        if rules.frames is None:
            fly_waypoints(b.motion, b.ledger, b.episode, rules.constants, rules.geometry, b.stepping, targets, samples)
        else:
            fly_body_legs(b.motion, b.ledger, b.episode, rules.constants, rules.geometry, b.body, rules.frames,
                          rules.rotors, b.surroundings.winds, b.stepping, targets, samples)  # fmt: skip
        b.settle(cursor, is_step=True)

    def fly_period(self, commands: FloatArray, declarations: FloatArray | None, cursor: int, *, tracks: bool) -> None:
        """One decision period; see `World.step_velocities` and, if it `tracks`, `World.step_setpoints`."""
        b, rules = self, self.rules
        b.judge(declarations)
        if rules.frames is None:
            fly_periods(b.motion, b.ledger, b.episode, rules.constants, rules.geometry, b.stepping, commands, tracks)
        else:
            fly = fly_body_periods if rules.rotorpy is None else rules.rotorpy.fly_periods
            fly(b.motion, b.ledger, b.episode, rules.constants, rules.geometry, b.body, rules.frames, rules.rotors,
                b.surroundings.winds, b.stepping, commands, tracks)  # fmt: skip
        b.settle(cursor, is_step=True)

    def judge(self, declarations: FloatArray | None) -> None:
        """Judge what is declared, if declarations count."""
        if declarations is not None and not self.rules.reaching:
            judge(self.motion, self.ledger, self.episode, self.rules.constants, self.sources, declarations)

    def settle(self, cursor: int, *, is_step: bool) -> None:
        """What follows a flight or a reset in the worlds that took part: air and plume go on, then sample, talk, end,
        reward.
        """
        b, rules, around = self, self.rules, self.surroundings
        if not around.rests:
            around.follow(b.stepping, b.motion, b.episode)
        if b.faults is not None:
            b.faults.strike(b.motion, b.senses, b.episode, b.stepping, flown=is_step)
        around.read_rates(b.positions, b.stepping, b.rates)
        in_range = rules.talks and not rules.to_all
        at_once = is_step and not in_range and not rules.reaching
        settle(b.motion, b.ledger, b.senses, b.episode, rules.constants, b.stepping, around.winds, b.rates,
               around.sniffers, around.response, around.faults, rules.sampling_time,
               rules.talks and rules.to_all, b.rewards, b.team, at_once)  # fmt: skip
        if in_range:
            send_in_range(b.motion, b.ledger, b.senses, b.episode, rules.constants, b.stepping, b.links, b.heard,
                          b.contacts, b.sent, b.reach, cursor)  # fmt: skip
        if is_step and rules.reaching:
            end_at_source(b.motion, b.ledger, b.episode, rules.constants, b.sources, b.stepping)
        if is_step and not at_once:
            finish(b.motion, b.ledger, b.senses, b.episode, rules.constants, b.stepping, b.rewards, b.team)
        if rules.shaping:
            shape(b.motion, b.ledger, rules.constants, b.sources, b.stepping, b.rewards, is_step)
            b.team["reward"] = b.rewards.mean(axis=1)
