"""What the swarm searchers share: what they smell and hear, how they keep apart and inside, and how they cast.

A swarm searcher wishes a velocity at each decision (`HearingPilot.wish`) from its own filtered readings (`Senses`) and
from the frames that have reached it since its last decision, the newest of each sender (`heard`). Nothing older is
used: whoever is not heard now is not there. With latency or on the event clock a place heard is the one at sending.

A frame always holds the sender's place and last reading; what a policy adds are 32-bit numbers (`pack`). A payload
that is not of the expected length (b"" of another policy's UAV in a mixed team) is understood as none.

Diagonal casting is the plume finding of fluxotaxis (D. Zarzhitsky, D. Spears and W. Spears, IROS 2005): go diagonally,
and turn round the component that meets the boundary. Read differently: the diagonal lies in the frame of the mean wind,
first upwind; in 3D the height bounces as well, so much slower as the area is lower.
"""

from __future__ import annotations

import math
import struct
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import PrivateAttr

from baselines.driving import Driver, area_scale, concentration
from baselines.nearby_declaration import NearbyParameters, NearbyRule
from baselines.policy import Briefing, Command, Policy
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

CALM = 1e-3  # m/s: no wind
_HERE = 1e-9  # m: two UAVs at one place
_MOST = 3e38  # of 32-bit numbers
_MARGIN = 0.01  # of the area's scale: kept from the boundary with velocities
_FILTER_TIMES = (5.0, 15.0)  # s, with velocities and with legs: a leg brings one reading
_BRAKING_TIME = 1.0  # s
_LEG = 0.05  # of the area's scale


class Heard(NamedTuple):
    """A UAV whose frame has arrived since the last decision."""

    sender: int
    position: FloatArray  # (3,) m, when it sent
    distance: float  # m
    direction: FloatArray  # (3,) unit vector to it; of two UAVs at one place an agreed one, opposite for the two
    concentration: float  # its last reading, in the sensor's unit, or hits per second
    time: float  # s, mission clock when it sent
    payload: bytes


def pack(*numbers: float) -> bytes:
    """`numbers` as 32-bit floats, cut to their range."""
    return struct.pack(f"<{len(numbers)}f", *(min(max(number, -_MOST), _MOST) for number in numbers))


def unpack(payload: bytes, count: int) -> tuple[float, ...] | None:
    """The `count` numbers of a payload; None if it holds something else."""
    if len(payload) != 4 * count:
        return None
    numbers = struct.unpack(f"<{count}f", payload)
    return numbers if all(math.isfinite(number) for number in numbers) else None


def heard(inbox: Sequence[Message], position: FloatArray, uav: int, counts: bool, planar: bool) -> list[Heard]:
    """The newest frame of each sender in `inbox` as UAV `uav` at `position` (3,) m sees it, by number of sender.

    `planar`: heights do not count.
    """
    newest: dict[int, Message] = {}
    for message in inbox:
        if message.sender not in newest or message.time >= newest[message.sender].time:
            newest[message.sender] = message
    found = []
    for sender in sorted(newest):
        message = newest[sender]
        offset = message.position - position
        if planar:
            offset[2] = 0.0
        distance = math.sqrt(float(offset @ offset))
        direction = offset / distance if distance > _HERE else _agreed(uav, sender)
        smelt = concentration(counts, message.reading, message.sampling_time)
        found.append(Heard(sender, message.position, distance, direction, smelt, message.time, message.payload))
    return found


def _agreed(uav: int, other: int) -> FloatArray:
    """The horizontal direction from `uav` to `other` if they are at one place: that from `other` to `uav`, reversed."""
    angle = 2.4 * min(uav, other) + 1.3 * max(uav, other)
    sign = 1.0 if uav < other else -1.0
    return np.array([sign * math.cos(angle), sign * math.sin(angle), 0.0])


def repulsion(others: Sequence[Heard], distance: float) -> FloatArray:
    """(3,) away from all `others` nearer than `distance`, m: 1 - r / distance from each."""
    push = np.zeros(3)
    for other in others:
        if other.distance < distance:
            push -= other.direction * (1.0 - other.distance / distance)
    return push


class Senses:
    """One UAV's filtered readings: exponential means of concentration and wind over `time_constant`, s.

    None: 5 s with velocities, 15 s with legs. The first reading starts the mean.
    """

    __slots__ = (
        "_counts",
        "_seen",
        "_threshold",
        "_time",
        "concentration",
        "detected",
        "fresh",
        "time_constant",
        "wind",
    )

    def __init__(self, briefing: Briefing, time_constant: float | None = None) -> None:
        self.time_constant = _FILTER_TIMES[briefing.action == "leg"] if time_constant is None else time_constant
        self._counts, self._threshold = briefing.gas_sensor.reports == "hits", briefing.threshold
        self._time, self._seen = -math.inf, False
        self.concentration = 0.0  # in the sensor's unit, or hits per second
        self.fresh = 0.0  # the last reading, alike
        self.wind = np.zeros(3)  # m/s
        self.detected = -math.inf  # s, mission clock at the last detection

    def take(self, observation: Observation) -> None:
        """Take note of the last reading; a second call in a decision changes nothing."""
        elapsed = observation.time - self._time
        if elapsed <= 0.0:
            return
        share = -math.expm1(-elapsed / self.time_constant) if math.isfinite(elapsed) else 1.0
        self.wind += share * (observation.wind - self.wind)
        self._time = observation.time
        if observation.sampling_time <= 0.0:
            return
        self.fresh = concentration(self._counts, observation.reading, observation.sampling_time)
        self.concentration += (share if self._seen else 1.0) * (self.fresh - self.concentration)
        self._seen = True
        if observation.reading > self._threshold:
            self.detected = observation.time

    def smelt(self, time: float, within: float) -> bool:
        """Whether there was a detection within the last `within` s before `time`, s."""
        return time - self.detected <= within

    @property
    def upwind(self) -> FloatArray | None:
        """(3,) horizontal unit vector against the mean wind; None in a calm."""
        speed = math.hypot(self.wind[0], self.wind[1])
        return np.array([-self.wind[0] / speed, -self.wind[1] / speed, 0.0]) if speed > CALM else None


class Fence:
    """Keeps velocities inside the area: towards a wall no faster than what still stops `margin` before it."""

    __slots__ = ("_high", "_low")

    def __init__(self, briefing: Briefing) -> None:
        area = np.asarray(briefing.area, dtype=np.float64)
        margin = np.minimum(_MARGIN * area_scale(briefing), 0.1 * area)
        self._low, self._high = margin, area - margin

    def keep(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """`velocity` (3,) m/s at `position` (3,) m, cut."""
        back, ahead = np.minimum(self._low - position, 0.0), np.maximum(self._high - position, 0.0)
        return np.asarray(np.clip(velocity, back / _BRAKING_TIME, ahead / _BRAKING_TIME), dtype=np.float64)

    def outside(self, place: FloatArray) -> bool:
        """Whether `place` (3,) m lies horizontally beyond the fence."""
        return bool(np.any(place[:2] < self._low[:2]) or np.any(place[:2] > self._high[:2]))

    def rebound(self, height: float, sign: float) -> float:
        """The vertical direction at `height`, m: `sign`, turned round at the ground and the ceiling."""
        return 1.0 if height <= self._low[2] else -1.0 if height >= self._high[2] else sign


class DiagonalCast:
    """One UAV's diagonal casting, at `slant` rad upwind of the crosswind direction."""

    __slots__ = ("_arena", "_axis", "_fence", "_look", "_signs", "_slant", "_vertical")

    def __init__(self, briefing: Briefing, fence: Fence, slant: float, leg: float) -> None:
        self._fence, self._arena = fence, briefing.arena
        self._slant = slant
        self._look = leg if briefing.action == "leg" else briefing.speed * 2.0 * _BRAKING_TIME
        scale = area_scale(briefing)
        self._vertical = 0.0 if briefing.planar else 0.5 * min(1.0, float(briefing.area[2]) / scale)
        odd = -1.0 if briefing.uav % 2 else 1.0
        self._signs = [1.0, odd, odd]  # upwind, across, up
        self._axis = np.array([-1.0, 0.0, 0.0])  # upwind; before any wind is felt, an arbitrary direction

    def direction(self, position: FloatArray, upwind: FloatArray | None) -> FloatArray:
        """(3,) of at most unit length: where to go from `position` (3,) m."""
        if upwind is not None:
            self._axis = upwind
        across = np.array([-self._axis[1], self._axis[0], 0.0])
        for k, axis in enumerate((self._axis, across)):
            ahead = position + self._signs[k] * self._look * axis
            met = self._fence.outside(ahead)
            if k == 1 and not met and self._arena.obstructed:
                met = not self._arena.clear(position, np.clip(ahead, 0.0, self._arena.size))
            if met and not self._fence.outside(position - self._signs[k] * self._look * axis):
                self._signs[k] = -self._signs[k]
        self._signs[2] = self._fence.rebound(float(position[2]), self._signs[2])
        wished = math.sin(self._slant) * self._signs[0] * self._axis + math.cos(self._slant) * self._signs[1] * across
        wished[2] = self._vertical * self._signs[2]
        return wished / max(1.0, math.sqrt(float(wished @ wished)))


class HearingPilot:
    """One UAV's state of an episode: a subclass gives the wished velocity, and the payload if it sends one."""

    __slots__ = ("_driver", "briefing", "counts", "fence", "leg", "mode", "rule", "senses", "speed")

    def __init__(self, briefing: Briefing, parameters: HearingPolicy, leg: float | None = None) -> None:
        """`leg`, m: flown where the vehicle takes legs only; None: 0.05 of the area's scale."""
        self.briefing, self.mode = briefing, ""
        self.rule = NearbyRule(parameters, briefing) if briefing.declares else None
        self.senses, self.fence = Senses(briefing, parameters.filter_time), Fence(briefing)
        self.leg = _LEG * area_scale(briefing) if leg is None else leg  # m
        self._driver = Driver(briefing, self.leg)
        self.counts, self.speed = briefing.gas_sensor.reports == "hits", self._driver.speed

    def payload(self, observation: Observation) -> bytes | None:
        """What this decision's frame carries."""
        return None

    @abstractmethod
    def wish(self, observation: Observation, others: list[Heard]) -> FloatArray:
        """The wished velocity (3,) m/s."""

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next command."""
        self.senses.take(observation)
        others = heard(inbox, observation.position, self.briefing.uav, self.counts, self.briefing.planar)
        wished = self.wish(observation, others)
        if self.rule is not None:
            self.rule.take(observation)
            if self.rule.suspects:
                self.mode, wished = "suspect", np.zeros(3)
        if self.briefing.action != "leg":
            wished = self.fence.keep(observation.position, wished)
        return self._driver.drive(observation.position, wished)

    def radius(self, share: float, of_area: float) -> float:
        """m: `share` of the radio's radius, or `of_area` of the area's scale if it hears everybody or nobody."""
        radio = self.briefing.radio.radius
        return share * radio if 0.0 < radio < math.inf else of_area * area_scale(self.briefing)


class HearingPolicy(NearbyParameters, Policy):
    """Base of the swarm searchers: makes a pilot for each episode, and asks it. Declares only where it must."""

    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    # of the low-pass of readings and wind; None: 5 s with velocities, 15 s with legs
    filter_time: float | None = quantity(None, "s", gt=0)

    _pilot: HearingPilot | None = PrivateAttr(default=None)

    @abstractmethod
    def pilot(self, briefing: Briefing) -> HearingPilot:
        """A pilot for one episode."""

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`."""
        self._pilot = self.pilot(briefing)

    def _begun(self) -> HearingPilot:
        if self._pilot is None:
            raise RuntimeError(f"{self.name}: reset(briefing) comes before the first decision")
        return self._pilot

    def broadcast(self, observation: Observation) -> bytes | None:
        """What this decision's frame carries beside place and reading."""
        pilot = self._begun()
        pilot.senses.take(observation)
        return pilot.payload(observation)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next command, given what has been heard since the last one."""
        return self._begun().act(observation, inbox)

    def declaration(self) -> FloatArray | None:
        """(3,) m, the UAV's own place, once `NearbyRule` holds; never where it is enough to come near."""
        return self._pilot.rule.declared if self._pilot and self._pilot.rule else None

    @property
    def mode(self) -> str:
        """What the pilot is doing."""
        return self._pilot.mode if self._pilot else ""
