"""Chemotaxis: scan by lawn-mower until the gas sensor detects something, then climb the concentration gradient.

After "3-Dimensional Gas Source Localization via Chemotaxis using Uncrewed Aircraft Systems". `scan` is its pattern,
`gradient` its least squares (eqs 6 and 7), `pilot` its two modes; equations are numbered as there. The UAV is steered
by a target ahead of it, the paper's way point:

    scan     towards the pattern's next way point, `scan_carrot` ahead
    search   the window of N readings is not full:  p + v                                           (5)
             the window is full:                    p + g / |g|                                     (8)

The paper leaves much open. Defaults are readings with which its flights come out as published; the parameter restores
what is printed where that is something else:

    drift        p + v is cut to the scan's carrot ("clipped"). "printed" leaves it as it is: where a vehicle's
                 controller has kp > kd, its speed then grows without bound
    rank_rule    on a straight flight (7) has no solution: see `gradient`
    fill         Algorithm 2's window fills from the switch to the search on; or from the scan on
    both_sides   after a round that found nothing in any layer, the next one scans the other side of the start, if a
                 lane fits there (in the paper's cases none does); false: always the same side, as printed
    lost_time    a search that has lost the plume scans again; inf: it searches for good, as printed
    bounds_margin    the search's targets stay that far inside the area, since a vehicle that turns about overshoots;
                     0: anywhere in it

Beyond the paper: ways are clear of obstacles, and a search that meets one flies around it; of several UAVs each scans
a strip of its own, and one that hears of a detection flies there; a vehicle without setpoints flies each target as a
leg, with one sample at its end, and takes the last leg for v; a sensor that counts gives hits a second; declaring is by
`baselines.nearby_declaration`, for which the UAV holds still. Lag and noise of the sensor are not corrected.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import PrivateAttr, field_validator

from baselines.chemotaxis.gradient import Rule
from baselines.chemotaxis.pilot import Pilot
from baselines.chemotaxis.scan import FirstSide, Towards
from baselines.nearby_declaration import NearbyParameters
from baselines.policy import Briefing, Command, Policy, register_policy
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message

_SMALLEST_WINDOW = 4  # readings: a plane over space has four unknowns


@register_policy
class Chemotaxis(NearbyParameters, Policy):
    """Scan in layers, then follow the gradient of the last N readings."""

    name: ClassVar[str] = "chemotaxis"
    summary: ClassVar[str] = "lawn-mower scan in layers, then up the gradient of the last readings"
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    window: int = quantity(20, "")  # N, readings
    threshold: float | None = quantity(None, "unit of the reading", ge=0)  # c_thresh; None: the sensor's
    scan_carrot: float = quantity(2.5, "m", gt=0)  # how far ahead the target is
    search_carrot: float = quantity(1.0, "m", gt=0)  # the length of g / |g| in eq 8
    drift: Literal["clipped", "printed"] = "clipped"
    fill: Literal["search", "scan"] = "search"
    rank_rule: Rule = "jitter"
    jitter: float = quantity(1e-9, "m", ge=0)  # standard deviation, of the rule jitter
    probe_spread: float = quantity(0.02, "m", gt=0)  # of the rule probe: a direction with less is missing
    lane_shift: float = quantity(4.0, "m", gt=0)
    layers: int = quantity(3, "", ge=1)
    layer_heights: tuple[float, ...] | None = quantity(None, "m")  # above the arena's floor, in flying order
    turn_margin: float = quantity(1.5, "m", ge=0)
    bounds_margin: float = quantity(0.5, "m", ge=0)  # how far inside the area targets of the search stay
    obstacle_margin: float = quantity(0.5, "m", ge=0)  # that ways keep from obstacles where they can
    switching_radius: float = quantity(0.25, "m", gt=0)  # of a way point
    first_side: FirstSide = "nearer"
    scan_towards: Towards = "low_x"
    both_sides: bool = True
    lost_time: float = quantity(30.0, "s", gt=0, infinite=True)
    sharing: bool = True  # fly to detections of others that are heard by radio

    _pilot: Pilot | None = PrivateAttr(default=None)

    @field_validator("window")
    @classmethod
    def _determined(cls, window: int) -> int:
        if window < _SMALLEST_WINDOW:
            raise ValueError(f"window = {window}: must be at least {_SMALLEST_WINDOW}")
        return window

    @field_validator("layer_heights")
    @classmethod
    def _some(cls, heights: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if heights == ():
            raise ValueError("layer_heights = []: must have at least one entry")
        return heights

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for a layer outside the area."""
        self._pilot = Pilot(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next target; others are heard by the neighbour table of the observation."""
        if self._pilot is None:
            raise RuntimeError("chemotaxis: reset(briefing) comes before the first decision")
        return self._pilot.act(observation)

    def declaration(self) -> FloatArray | None:
        """(3,) m, where the rule holds."""
        return self._pilot.declaring.declared if self._pilot else None

    @property
    def mode(self) -> str:
        """scan, recruited or search."""
        return self._pilot.mode if self._pilot else ""
