"""Policies that fly checkpoints: `checkpoint` for any folder, and the shipped ones under names of their own."""

from __future__ import annotations

import importlib
from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from pydantic import Field, PrivateAttr, model_validator

from baselines.learned.checkpoint import HEADER_FILE, Checkpoint, shipped_folder
from baselines.learned.pilot import Brain, Pilot
from baselines.policy import Belief, Briefing, Command, Policy, register_policy
from osl_env.actions import Action
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message

_SEARCH = "baselines.search_agent.policy"  # its `pilot(checkpoint, stochastic)` flies the agent `search`


class PilotedPolicy(Policy):
    """A policy whose parameters choose the pilot that flies it; it hands everything on to that pilot.

    `sha256` is filled in with a digest of weights and definitions, so that records and stores say what was flown;
    given, others are refused.
    """

    stochastic: bool = False  # draw actions from the network's distribution, instead of the most probable
    sha256: str = Field(default="", pattern=r"^([0-9a-f]{64})?$")

    _pilot: Policy = PrivateAttr()

    @abstractmethod
    def _loaded(self) -> tuple[Policy, str]:
        """The pilot and a SHA-256 of what it is. Raises InputError."""

    @model_validator(mode="after")
    def _load(self) -> PilotedPolicy:
        pilot, digest = self._loaded()
        if self.sha256 not in ("", digest):
            raise InputError(f"sha256 = {self.sha256[:12]}..: what is there has {digest[:12]}..")
        self._pilot = pilot
        object.__setattr__(self, "sha256", digest)
        return self

    @property
    def vehicle_commands(self) -> tuple[Command, ...]:  # type: ignore[override]  # by the network's actions
        """The one kind of command that the pilot gives."""
        return self._pilot.vehicle_commands

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`. Raises InputError if the network must not fly it."""
        self._pilot.reset(briefing)

    def broadcast(self, observation: Observation) -> bytes | None:
        """The pilot's payload."""
        return self._pilot.broadcast(observation)

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The pilot's action."""
        return self._pilot.act(observation, inbox)

    @classmethod
    def act_batch(
        cls, pilots: Sequence[Policy], observations: Sequence[Observation], inboxes: Sequence[Sequence[Message]]
    ) -> list[Action]:
        """The actions of copies of one policy, all at once."""
        crew = [policy._pilot for policy in pilots if isinstance(policy, PilotedPolicy)]
        return type(crew[0]).act_batch(crew, observations, inboxes)

    def belief(self) -> Belief | None:
        """The pilot's belief, if it holds one."""
        return self._pilot.belief()

    def declaration(self) -> FloatArray | None:
        """(3,) m, once the pilot declares."""
        return self._pilot.declaration()

    @property
    def computed_bits(self) -> float:
        """Bits processed at the last decision."""
        return self._pilot.computed_bits


def pilot_of(checkpoint: Checkpoint, stochastic: bool) -> Policy:
    """The pilot that flies `checkpoint`, by its kind of agent."""
    if checkpoint.header.agent == "search":
        pilot: Policy = importlib.import_module(_SEARCH).pilot(checkpoint, stochastic)
        return pilot
    return Pilot.of(Brain.of(checkpoint), stochastic)


class LearnedPolicy(PilotedPolicy):
    """Base of the policies that fly a checkpoint's folder."""

    @abstractmethod
    def _folder(self) -> Path:
        """Where the checkpoint lies."""

    def _loaded(self) -> tuple[Policy, str]:
        checkpoint = Checkpoint.load(self._folder())
        return pilot_of(checkpoint, self.stochastic), checkpoint.digest


@register_policy
class CheckpointPolicy(LearnedPolicy):
    """Flies the checkpoint in the folder `path`, whatever its kind of agent."""

    name: ClassVar[str] = "checkpoint"
    summary: ClassVar[str] = "any checkpoint's folder (path=), flown without torch"

    path: Path

    def _folder(self) -> Path:
        return self.path


class RppoRaw(LearnedPolicy):
    """The shipped recurrent agent without a model of the plume."""

    name: ClassVar[str] = "rppo-raw"
    summary: ClassVar[str] = "learned: recurrent PPO on raw observations, no model of the plume"

    stochastic: bool = True  # its most probable actions go in circles where there is nothing to smell

    def _folder(self) -> Path:
        return shipped_folder(self.name)


class PpoBelief(LearnedPolicy):
    """The shipped agent that scores goals from its belief; without its network, the rule that training began with."""

    name: ClassVar[str] = "ppo-belief"
    summary: ClassVar[str] = "learned: PPO moves the levers of a rule that scores goals from a grid belief"

    learned: bool = True  # False: all levers at 0, to see what the learning adds

    def _folder(self) -> Path:
        return shipped_folder(self.name)

    def _loaded(self) -> tuple[Policy, str]:
        pilot, digest = super()._loaded()
        return (pilot if self.learned else pilot.model_copy(update={"learned": False})), digest


for _policy in (RppoRaw, PpoBelief):
    if (shipped_folder(_policy.name) / HEADER_FILE).is_file():
        register_policy(_policy)
