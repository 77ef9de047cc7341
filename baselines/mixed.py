"""Mixed teams: a policy for each UAV, written as one, `swarm*10+surge-cast*5` or `muc-osl+lawnmower`.

UAVs are given to the members in the order in which they are written: the first ten fly `swarm`, the next five
`surge-cast`. Members without a number share the remaining UAVs, one each in turn. A parameter is that of the member it
begins with: `swarm.k1`. The world flies one kind of command at a time, so the members must have one in common.

The radio is shared, payloads are not: each begins with a byte that says whose it is, and what another kind of policy
sent arrives without its payload. Its position and reading are still heard.
"""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pydantic import Field, PrivateAttr

from baselines.policy import Belief, Briefing, Command, Policy, make_policy
from osl_env.actions import Action
from osl_env.errors import InputError
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.radio import Message

MOST_KINDS = 8


class MixedTeam(Policy):
    """Several policies in one team; `baselines.make_policy` makes it of a name with `+` or `*`."""

    summary: ClassVar[str] = "several policies in one team"

    team: str  # as it is written
    members: tuple[tuple[str, int | None], ...]  # (policy, UAVs); None: its share of the rest
    parameters: dict[str, dict[str, Any]] = Field(default_factory=dict)  # of the members, by name

    _members: tuple[Policy, ...] = PrivateAttr(default=())
    _kind: int = PrivateAttr(default=0)  # this UAV's member
    _own: Policy | None = PrivateAttr(default=None)

    @classmethod
    def of(
        cls, team: str, members: Sequence[tuple[Policy, int | None]], parameters: dict[str, dict[str, Any]]
    ) -> MixedTeam:
        """The team of `members` (policy, UAVs). Raises InputError if they cannot fly together."""
        names = tuple((policy.name, number) for policy, number in members)
        mixed = cls(team=team, members=names, parameters=parameters)
        mixed._members = tuple(policy for policy, _ in members)
        for what, common in (("command", mixed.vehicle_commands), ("kind of reading", mixed.plume_quantities)):
            if not common:
                raise InputError(f"policy {team}: its members have no {what} in common")
        return mixed

    @property
    def name(self) -> str:  # type: ignore[override]  # one for each team
        """As it was written."""
        return self.team

    @property
    def vehicle_commands(self) -> tuple[Command, ...]:  # type: ignore[override]  # what all can command
        """What every member can command, in the first one's order of preference."""
        first, *others = self._members
        flown = [set(other.vehicle_commands) for other in others]
        return tuple(command for command in first.vehicle_commands if all(command in other for other in flown))

    @property
    def plume_quantities(self) -> tuple[str, ...]:  # type: ignore[override]  # what all understand
        """The kinds of reading that every member understands."""
        first, *others = self._members
        return tuple(kind for kind in first.plume_quantities if all(kind in other.plume_quantities for other in others))

    def kinds(self, n_uavs: int) -> list[int]:
        """Which member each of `n_uavs` UAVs flies. Raises InputError if the numbers do not fit."""
        fixed = sum(number or 0 for _, number in self.members)
        sharing = [kind for kind, (_, number) in enumerate(self.members) if number is None]
        rest = n_uavs - fixed
        if rest < len(sharing) or (rest > 0 and not sharing):
            least = f"at least {fixed + len(sharing)}" if sharing else f"{fixed}"
            raise InputError(f"policy {self.team}: is a team of {least} UAVs, the scenario has team.n_uavs = {n_uavs}")
        shares = Counter(sharing[k % len(sharing)] for k in range(rest)) if sharing else Counter()
        return [
            kind
            for kind, (_, number) in enumerate(self.members)
            for _ in range(shares[kind] if number is None else number)
        ]

    def reset(self, briefing: Briefing) -> None:
        """Start an episode with `briefing`, as the member that this UAV flies."""
        self._kind = self.kinds(briefing.n_uavs)[briefing.uav]
        self._own = copy.deepcopy(self._members[self._kind])
        self._own.reset(briefing)

    @property
    def pilot(self) -> Policy:
        """The member that this UAV flies."""
        if self._own is None:
            raise RuntimeError("mixed team: reset(briefing) comes before the first decision")
        return self._own

    def broadcast(self, observation: Observation) -> bytes | None:
        """The member's payload, after a byte that says whose it is; nothing if it has none."""
        payload = self.pilot.broadcast(observation)
        return bytes((self._kind,)) + payload if payload else None

    def act(self, observation: Observation, inbox: Sequence[Message]) -> Action:
        """The member's command; payloads of other members are not for it."""
        return self.pilot.act(observation, [_for(message, self._kind) for message in inbox])

    @classmethod
    def act_batch(
        cls, pilots: Sequence[Policy], observations: Sequence[Observation], inboxes: Sequence[Sequence[Message]]
    ) -> list[Action]:
        """`act` of all pilots: those of one member decide together."""
        teams = [pilot for pilot in pilots if isinstance(pilot, MixedTeam)]
        actions: dict[int, Action] = {}
        for kind in sorted({pilot._kind for pilot in teams}):
            rows = [row for row, pilot in enumerate(teams) if pilot._kind == kind]
            own = [teams[row].pilot for row in rows]
            opened: dict[int, Message] = {}  # one object for all who hear a message
            heard = [[_opened(message, kind, opened) for message in inboxes[row]] for row in rows]
            decided = type(own[0]).act_batch(own, [observations[row] for row in rows], heard)
            actions.update(zip(rows, decided, strict=True))
        return [actions[row] for row in range(len(teams))]

    def belief(self) -> Belief | None:
        """The member's."""
        return self.pilot.belief()

    def declaration(self) -> FloatArray | None:
        """(3,) m, the member's."""
        return self.pilot.declaration()

    @property
    def mode(self) -> str:
        """The member's."""
        return self.pilot.mode

    @property
    def computed_bits(self) -> float:
        """The member's."""
        return self.pilot.computed_bits


def _for(message: Message, kind: int) -> Message:
    """`message` as member `kind` gets it."""
    payload = message.payload
    return message._replace(payload=payload[1:] if payload and payload[0] == kind else b"")


def _opened(message: Message, kind: int, opened: dict[int, Message]) -> Message:
    if id(message) not in opened:
        opened[id(message)] = _for(message, kind)
    return opened[id(message)]


def members_of(team: str) -> list[tuple[str, int | None]]:
    """`swarm*10+surge-cast` -> [("swarm", 10), ("surge-cast", None)]. Raises InputError for anything else."""
    members: list[tuple[str, int | None]] = []
    for part in team.split("+"):
        name, times, number = (text.strip() for text in part.partition("*"))
        if not name or (times and not (number.isascii() and number.isdigit() and int(number) > 0)):
            raise InputError(f"policy {team!r}: must be names with numbers of UAVs, as in swarm*10+surge-cast*5")
        if name in dict(members):
            raise InputError(f"policy {team!r}: {name} comes twice")
        members.append((name, int(number) if number else None))
    if len(members) > MOST_KINDS:
        raise InputError(f"policy {team!r}: {len(members)} members, at most {MOST_KINDS} are allowed")
    return members


def mixed_team(team: str, members: Sequence[tuple[str, int | None]], parameters: Mapping[str, Any]) -> MixedTeam:
    """The team written as `team`, with `parameters` as `NAME.KEY`. Raises InputError for any that does not fit."""
    own: dict[str, dict[str, Any]] = {}
    for key, value in parameters.items():
        name, _, parameter = key.partition(".")
        if not parameter or name not in dict(members):
            allowed = ", ".join(f"{member}.KEY" for member, _ in members)
            raise InputError(f"policy {team}: unknown key {key!r}: allowed are {allowed}")
        own.setdefault(name, {})[parameter] = value
    return MixedTeam.of(team, [(make_policy(name, **own.get(name, {})), number) for name, number in members], own)
