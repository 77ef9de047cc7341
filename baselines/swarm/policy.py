"""Swarm plume tracking and plume finding (Marjovi and Marques), as policies.

`swarm`: robots look for the plume in a line (`finding`); the first whose reading is a detection says so by radio, which
every robot that hears it passes on, and whoever knows follows the control law (`law`). A robot uses its own sensors
and the frames heard since its last decision, no more: its own temporal mean concentration, its position and what it
knows of the plume are all that it sends. Cmax (eq 6) is the largest mean that it had itself or has heard.
`plume-finding`: the line alone, which never stops sweeping: how long does a team take to meet a plume?

The temporal mean is exponential, exact for decisions of any duration with the reading held since the last one; it
begins with clean air. Counting sensors give hits/s. The law's force is flown as the velocity, cut to the vehicle's
speed, or as a leg in its direction. k1 is meant for g/m^3: in other units the concentration is divided by
`concentration_scale` first, by default the sensor's scale. Not in the paper: R1 and R2 as functions of delta_d, linear
between its two settings (delta_d 1 m: 0.1 and 0.5 m; 6 m: 2.2 and 3.3 m). A robot without range sensors goes around
obstacles by the map instead of eq 8. Where a source must be declared, `nearby_declaration` does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from pydantic import PrivateAttr, model_validator

from baselines.nearby_declaration import NearbyParameters
from baselines.policy import Briefing, Command, Policy, register_policy
from baselines.swarm.finding import FindingParameters
from baselines.swarm.law import LawParameters
from baselines.swarm.robot import Robot, default_distances
from baselines.swarm.steering import ROBOT, gather, pack, steer
from osl_env.actions import Action
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message


class Searcher(NearbyParameters, FindingParameters, Policy):
    """What `swarm` and `plume-finding` share: the line, the obstacle forces, and deciding in batches."""

    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")
    tracks: ClassVar[bool] = False  # follows the law once the plume is known

    obstacle_gain: float = quantity(1.0, "", ge=0)  # c1
    obstacle_exponent: float = quantity(2.0, "", ge=0, le=8)  # n
    neighbour_distance: float | None = quantity(None, "m", gt=0)  # delta_d; None: see the function of this name
    leg_length: float | None = quantity(None, "m", gt=0)  # where legs are flown; None: a quarter of delta_d

    _robot: Robot | None = PrivateAttr(default=None)

    @property
    def searches(self) -> bool:
        """Whether it begins with plume finding."""
        return True

    @property
    def mean_time(self) -> float:
        """s, time constant of the temporal mean."""
        return 0.0

    def law(self, briefing: Briefing, hearing: float) -> LawParameters:
        """The law's numbers in the scenario of `briefing`, `hearing` being delta_d, m."""
        return LawParameters(
            obstacle_gain=self.obstacle_gain,
            obstacle_exponent=self.obstacle_exponent,
            sensor_range=briefing.range_sensors.range,
        )

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError if R1 is not below R2."""
        self._robot = Robot(self, briefing)

    @property
    def robot(self) -> Robot:
        """The robot's state. Raises RuntimeError before the first reset."""
        private = self.__pydantic_private__  # as `self._robot`, which takes pydantic a microsecond to look up
        robot: Robot | None = private["_robot"] if private else None
        if robot is None:
            raise RuntimeError(f"{self.name}: reset(briefing) comes before the first decision")
        return robot

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The velocity of the next period, or the next leg."""
        return self.act_batch([self], [observation], [inbox])[0]

    @classmethod
    def act_batch(
        cls, pilots: Sequence[Policy], observations: Sequence[Observation], inboxes: Sequence[Sequence[Message]]
    ) -> list[Action]:
        """`act` of all `pilots` in one call of the kernel."""
        robots = [pilot.robot for pilot in pilots if isinstance(pilot, Searcher)]
        n = len(robots)
        for robot, seen in zip(robots, observations, strict=True):
            robot.take(seen)
        rows = np.array([robot.row() for robot in robots], dtype=ROBOT)
        wished = np.array([robot.wish(seen) for robot, seen in zip(robots, observations, strict=True)])
        velocity = np.empty((n, 3))
        steer(
            rows,
            np.concatenate([robot.numbers for robot in robots]).reshape(n, -1),
            np.concatenate([seen.position for seen in observations]).reshape(n, 3),
            np.concatenate([seen.wind for seen in observations]).reshape(n, 3),
            wished,
            np.concatenate([seen.ranges for seen in observations]).reshape(n, -1),
            gather(inboxes, robots[0].counts),
            velocity,
        )
        for robot, largest, found in zip(robots, rows["largest"].tolist(), rows["found"].tolist(), strict=True):
            robot.largest, robot.found = largest, found
        return [robot.action(seen, v) for robot, seen, v in zip(robots, observations, velocity, strict=True)]

    def declaration(self) -> FloatArray | None:
        """(3,) m, the robot's own place, once the rule holds."""
        rule = self.robot.rule
        return rule.declared if rule else None

    @property
    def mode(self) -> str:
        """ "finding" or "tracking"."""
        robot = self._robot
        return "tracking" if robot and robot.tracks and robot.found else "finding"


@register_policy
class PlumeFinding(Searcher):
    """Sweep crosswind in a line, and go on doing so."""

    name: ClassVar[str] = "plume-finding"
    summary: ClassVar[str] = "robots in a line sweep crosswind and move upwind, to meet a plume"


@register_policy
class Swarm(Searcher):
    """Swarm plume tracking by neighbours' concentrations, wind, cohesion and obstacle forces (eqs 1 to 9)."""

    name: ClassVar[str] = "swarm"
    summary: ClassVar[str] = (
        "plume tracking by virtual forces between radio neighbours, after finding the plume in a line"
    )
    tracks: ClassVar[bool] = True

    filter_time: float = quantity(5.0, "s", ge=0)  # of the temporal mean; 0: none
    gradient_gain: float = quantity(50.0, "m^5/(g s)", ge=0)  # k1
    wind_gain: float = quantity(0.5, "", ge=0)  # k2
    repulsion_gain: float = quantity(1.0, "m^3/s", ge=0)  # mu1
    attraction_gain: float = quantity(1.0, "m^3/s", ge=0)  # mu2
    repulsion_distance: float | None = quantity(None, "m", ge=0)  # R1; None: from delta_d
    attraction_distance: float | None = quantity(None, "m", gt=0)  # R2; None: from delta_d
    odor_gain: float = quantity(1.0, "", gt=0)  # beta
    clean_air: float = quantity(0.0, "unit of the plume", ge=0)  # C0
    sign: Literal["text", "printed"] = "text"  # of eq 5
    concentration_scale: float | None = quantity(None, "unit of the plume", gt=0)  # None: 1 g/m^3, else the sensor's
    finding: bool = True  # begin with plume finding; else the law holds from the start

    @model_validator(mode="after")
    def _consistent(self) -> Swarm:
        near, far = self.repulsion_distance, self.attraction_distance
        if near is not None and far is not None and near >= far:
            raise ValueError(f"repulsion_distance = {near:g}: must be below attraction_distance = {far:g}")
        return self

    @property
    def searches(self) -> bool:
        """As `finding` says."""
        return self.finding

    @property
    def mean_time(self) -> float:
        """As `filter_time` says."""
        return self.filter_time

    def law(self, briefing: Briefing, hearing: float) -> LawParameters:
        """The law's numbers; the gradient's gain is for concentrations that are not yet divided by their scale."""
        near, far = default_distances(hearing)
        near = near if self.repulsion_distance is None else self.repulsion_distance
        far = far if self.attraction_distance is None else self.attraction_distance
        if near >= far:
            raise InputError(
                f"policy swarm: repulsion_distance = {near:g}: must be below attraction_distance = {far:g}"
                f" (None is taken from delta_d = {hearing:g} m)"
            )
        scale = self.concentration_scale or _concentration_scale(briefing)
        return LawParameters(
            gradient_gain=self.gradient_gain / scale,
            wind_gain=self.wind_gain,
            repulsion_gain=self.repulsion_gain,
            attraction_gain=self.attraction_gain,
            repulsion_distance=near,
            attraction_distance=far,
            sign=1.0 if self.sign == "text" else -1.0,
            odor_gain=self.odor_gain,
            clean_air=self.clean_air,
            obstacle_gain=self.obstacle_gain,
            obstacle_exponent=self.obstacle_exponent,
            sensor_range=briefing.range_sensors.range,
        )

    def broadcast(self, observation: Observation) -> bytes | None:
        """The robot's temporal mean concentration, and whether it knows of the plume."""
        self.robot.take(observation)
        return pack(self.robot.concentration, self.robot.found)


def _concentration_scale(briefing: Briefing) -> float:
    """What k1 takes for 1 g/m^3: that, or the gas sensor's scale in its own unit."""
    sensor = briefing.gas_sensor
    if sensor.reports == "concentration" and briefing.plume.unit == "g/m^3":
        return 1.0
    return float(sensor.scale)
