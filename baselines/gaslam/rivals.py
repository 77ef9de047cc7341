"""What GaSLAM is compared with: three policies that share its maps and its flying, each without a part of it.

    kernel-peak        no source term: the source is the cell where the kernel map is highest, after a boustrophedon
                       flight over the volume (`survey`)
    boustrophedon-ste  no navigation: the same flight, with GaSLAM's source term estimation and vote
    rahbar-ste         the navigation of Rahbar et al. 2019 (`information`), with GaSLAM's estimation and vote

As `gaslam`, they take in every reading of the flight, and with `sharing` those that they hear of, know the obstacles,
and declare at the end of the budget; where no gas was found they declare nothing. A posterior is sampled each time that
a goal is reached, but at most once in `goal_time`. `mapping` holds the maps.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from pydantic import PrivateAttr

from baselines.gaslam.declaration import VoteParameters
from baselines.gaslam.information import InformationParameters
from baselines.gaslam.mapping import Mapping
from baselines.gaslam.rival_flights import Flight, FlightParameters, InformedFlight, PeakFlight, SurveyFlight
from baselines.gaslam.survey import SurveyParameters
from baselines.policy import Belief, Briefing, Command, Policy, register_policy
from osl_env.actions import Action
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message


class _Rival(FlightParameters, Policy):
    """What the three have in common."""

    vehicle_commands: ClassVar[tuple[Command, ...]] = ("velocity", "setpoint", "leg")
    plume_quantities: ClassVar[tuple[str, ...]] = ("hit_rate", "concentration")

    _flight: Flight | None = PrivateAttr(default=None)

    @abstractmethod
    def _begin(self, briefing: Briefing) -> Flight: ...

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError for cells that the area cannot have."""
        self._flight = self._begin(briefing)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The next command; others are heard by the neighbour table of the observation."""
        if self._flight is None:
            raise RuntimeError(f"{self.name}: reset(briefing) comes before the first decision")
        return self._flight.act(observation)

    def belief(self) -> Belief | None:
        """What the last estimate says of the source, and the final map by what is known now."""
        return self._flight.belief() if self._flight else None

    def declaration(self) -> FloatArray | None:
        """(3,) m, the estimated source, once the budget ends."""
        return self._flight.declared if self._flight else None

    @property
    def mapping(self) -> Mapping | None:
        """The maps; None before the first reset."""
        return self._flight.mapping if self._flight else None

    @property
    def mode(self) -> str:
        """survey, explore or record."""
        return self._flight.mode if self._flight else ""

    @property
    def computed_bits(self) -> float:
        """Bits of the cells gone through, at every iteration of Metropolis-Hastings."""
        return self._flight.bits if self._flight else 0.0


@register_policy
class KernelPeak(SurveyParameters, _Rival):
    """Map the gas on a boustrophedon flight, and declare the cell where the map is highest.

    Of the parameters of the maps, `source_term`, `estimate` and `goal_time` have no part in it.
    """

    name: ClassVar[str] = "kernel-peak"
    summary: ClassVar[str] = "boustrophedon flight that maps the gas; the source is the map's peak"

    def _begin(self, briefing: Briefing) -> Flight:
        return PeakFlight(self, briefing)


@register_policy
class BoustrophedonSTE(SurveyParameters, VoteParameters, _Rival):
    """Map the gas on a boustrophedon flight, and estimate the source term as GaSLAM does."""

    name: ClassVar[str] = "boustrophedon-ste"
    summary: ClassVar[str] = "boustrophedon flight with gaslam's source term estimation and vote"

    def _begin(self, briefing: Briefing) -> Flight:
        return SurveyFlight(self, briefing)


@register_policy
class RahbarSTE(InformationParameters, VoteParameters, _Rival):
    """Fly where a reading is expected to teach most of the source term, and estimate it as GaSLAM does."""

    name: ClassVar[str] = "rahbar-ste"
    summary: ClassVar[str] = "information-driven flight with gaslam's source term estimation and vote"

    def _begin(self, briefing: Briefing) -> Flight:
        return InformedFlight(self, briefing)
