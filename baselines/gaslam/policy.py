"""GaSLAM: simultaneous gas source localization and gas distribution mapping in 3D.

After "GaSLAM: an algorithm for simultaneous gas source localization and gas distribution mapping in 3D"; equations are
numbered as in `papers/gaslam.md`. Every reading goes into a kernel map (`kernel_map`). At each goal a pseudo-Gaussian
plume is fitted to it by Metropolis-Hastings (`source_term`), and the next goal is chosen between the cells of which
least is known and the source that the fit gives (`navigation`). At the end of its time budget the UAV declares the
source by a vote among the estimates that it was sure of (`declaration`).

Defaults are our readings of what the paper leaves open; each module says which, and the parameter that restores what is
printed:

    vectors="printed", difference="printed", tie_margin=0, weighting="printed", used_cells="all"

Beyond the paper: any area, wind direction and sensor (`mapping` says how lengths and errors scale); ways keep clear of
obstacles; velocities, setpoints or legs, these with `samples` at each goal; the budget may end by time, energy or
decisions. Of several UAVs each flies and declares for itself, and with `sharing` enters what the others read as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from pydantic import PrivateAttr

from baselines.gaslam.declaration import VoteParameters
from baselines.gaslam.mapping import Mapping, MappingParameters
from baselines.gaslam.navigation import NavigationParameters
from baselines.gaslam.pilot import Pilot
from baselines.policy import Belief, Briefing, Command, Policy, register_policy
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray, quantity
from osl_env.radio import Message


@register_policy
class GaSLAM(MappingParameters, NavigationParameters, VoteParameters, Policy):
    """Map the gas, fit a plume to the map, and fly between the unknown and the estimated source."""

    name: ClassVar[str] = "gaslam"
    summary: ClassVar[str] = "maps the gas and fits a plume to the map; between unknown cells and the estimated source"
    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    goal_distance: float = quantity(1.0, "m", gt=0)  # of unit vectors, in the paper's volume
    arrival_radius: float = quantity(0.1, "m", gt=0)  # at a goal, in the paper's volume
    goal_time: float = quantity(1.0, "s", ge=0)  # that a goal is kept at least
    samples: int = quantity(1, "", ge=1)  # at the end of a leg

    _pilot: Pilot | None = PrivateAttr(default=None)

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for cells that the area cannot have."""
        self._pilot = Pilot(self, briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next command; others are heard by the neighbour table of the observation."""
        if self._pilot is None:
            raise RuntimeError("gaslam: reset(briefing) comes before the first decision")
        return self._pilot.act(observation)

    def belief(self) -> Belief | None:
        """The posterior of the last estimate, and the final map by what is known now."""
        return self._pilot.mapping.belief() if self._pilot else None

    def declaration(self) -> FloatArray | None:
        """(3,) m, the voted source, once the budget ends."""
        return self._pilot.declared if self._pilot else None

    @property
    def mapping(self) -> Mapping | None:
        """The maps and the estimate so far; None before the first reset."""
        return self._pilot.mapping if self._pilot else None

    @property
    def mode(self) -> str:
        """explore, exploit or record."""
        return self._pilot.mode if self._pilot else ""

    @property
    def computed_bits(self) -> float:
        """Bits of the cells gone through, at every iteration of Metropolis-Hastings."""
        return self._pilot.bits if self._pilot else 0.0
