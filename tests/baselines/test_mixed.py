"""Mixed teams: who flies what, that payloads stay among their kind, and that a mixed team of one kind is that kind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import small

from baselines import make_policy
from baselines.mixed import MixedTeam, members_of
from osl_env import InputError
from osl_env.record import EpisodeRecord
from training import evaluate
from training.flight import fly


def team(written: str, **parameters: object) -> MixedTeam:
    made = make_policy(written, **parameters)
    assert isinstance(made, MixedTeam)
    return made


def flown(record: EpisodeRecord, *without: str) -> dict[str, Any]:
    """What happened, NaN as None so that it compares."""
    return {key: value for key, value in record.to_dict().items() if key not in without}


@pytest.mark.parametrize(
    ("written", "n_uavs", "kinds"),
    [
        ("muc-osl*2+lawnmower*1", 3, [0, 0, 1]),
        ("muc-osl+lawnmower", 5, [0, 0, 0, 1, 1]),
        ("muc-osl+lawnmower*3", 5, [0, 0, 1, 1, 1]),
        ("muc-osl*3", 3, [0, 0, 0]),
    ],
)
def test_uavs_are_given_out_in_the_order_written(written: str, n_uavs: int, kinds: list[int]) -> None:
    assert team(written).kinds(n_uavs) == kinds
    flight = fly(team(written), small(**{"team.n_uavs": n_uavs, "action": "waypoint", "team.starts": [[1, 1, 1]] * 8}),
                 [1], max_decisions=2)  # fmt: skip
    names = [pilot.pilot.name for pilot in flight.team[0] if isinstance(pilot, MixedTeam)]
    assert names == [members_of(written)[kind][0] for kind in kinds]


@pytest.mark.parametrize("name", ["muc-osl", "team-infotaxis", "surge-cast"])
def test_a_team_of_one_kind_flies_as_that_kind(name: str) -> None:
    task = small(**{"action": "waypoint", "ending.time_limit": 40.0})
    (plain,), (mixed,) = (evaluate(make_policy(n), task, [5], n_jobs=1, progress=False) for n in (name, f"{name}*3"))
    own = ("policy", "parameters", "decision_seconds", "bytes", "energy_communicating")
    assert flown(mixed, *own) == flown(plain, *own)
    assert mixed.policy == f"{name}*3"
    assert mixed.bytes >= plain.bytes  # a byte a frame with a payload says whose it is


def test_batches_and_single_episodes_of_a_mixed_team_are_the_same() -> None:
    task = small(**{"action": "waypoint", "ending.time_limit": 30.0})
    mixed = team("muc-osl*2+surge-cast*1")
    together = evaluate(mixed, task, [3, 4, 5], n_jobs=1, progress=False)
    alone = [evaluate(mixed, task, [seed], n_jobs=1, progress=False)[0] for seed in (3, 4, 5)]
    assert [flown(one, "decision_seconds") for one in together] == [flown(one, "decision_seconds") for one in alone]


def test_payloads_reach_only_their_own_kind() -> None:
    task = small(action="waypoint")
    flight = fly(team("muc-osl*2+col-pf*1"), task, [2], max_decisions=1)
    observation = flight.world.observation(0, 0)
    payloads = [pilot.broadcast(observation) for pilot in flight.team[0]]
    inboxes = flight.world.exchange([payloads])[0]
    heard: list[list[bytes]] = []
    for pilot, inbox in zip(flight.team[0], inboxes, strict=True):
        assert isinstance(pilot, MixedTeam)
        kept: list[bytes] = []
        own = pilot.pilot
        original = type(own).act

        def listen(self: object, seen: object, opened: list, kept: list[bytes] = kept) -> None:
            kept.extend(message.payload for message in opened)

        type(own).act = listen  # type: ignore[assignment,method-assign]
        try:
            pilot.act(observation, inbox)
        finally:
            type(own).act = original  # type: ignore[method-assign]
        heard.append(kept)
    own_payloads = [payload[1:] if payload else b"" for payload in payloads]
    assert own_payloads[0]
    assert heard[0] == [own_payloads[1], b""]
    assert heard[1] == [own_payloads[0], b""]
    assert heard[2] == [b"", b""]


def test_parameters_go_to_the_member_that_they_name() -> None:
    mixed = team("muc-osl*2+lawnmower*1", **{"muc-osl.particles": 40})
    assert mixed.parameters == {"muc-osl": {"particles": 40}}
    flight = fly(mixed, small(action="waypoint"), [1], max_decisions=1)
    pilot = flight.team[0][0]
    assert isinstance(pilot, MixedTeam)
    assert pilot.pilot.model_dump()["particles"] == 40


@pytest.mark.parametrize(
    ("written", "parameters", "says"),
    [
        ("muc-osl*0", {}, "must be names with numbers of UAVs"),
        ("muc-osl*x+lawnmower", {}, "must be names with numbers of UAVs"),
        ("+muc-osl", {}, "must be names with numbers of UAVs"),
        ("muc-osl+muc-osl", {}, "muc-osl comes twice"),
        ("muc-osl+no-such", {}, "unknown policy 'no-such'"),
        ("muc-osl+lawnmower", {"particles": 40}, "unknown key 'particles': allowed are muc-osl.KEY, lawnmower.KEY"),
        ("muc-osl+lawnmower", {"col-pf.particles": 40}, "unknown key 'col-pf.particles'"),
        ("muc-osl+lawnmower", {"muc-osl.particle": 40}, "policy muc-osl: unknown key 'particle'"),
    ],
)
def test_bad_teams_are_refused_in_one_line(written: str, parameters: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        make_policy(written, **parameters)
    assert "\n" not in str(refused.value)


def test_members_must_have_a_command_and_a_kind_of_reading_in_common() -> None:
    class Steered(MixedTeam):
        vehicle_commands = ("setpoint",)  # type: ignore[assignment]

    class Measuring(MixedTeam):
        plume_quantities = ("concentration",)  # type: ignore[assignment]

    hopping = make_policy("muc-osl")
    for other, says in ((Steered, "no command in common"), (Measuring, "no kind of reading in common")):
        stranger = other(team="stranger", members=())
        stranger._members = (make_policy("lawnmower"),)
        with pytest.raises(InputError, match=says):
            MixedTeam.of("muc-osl+stranger", [(hopping, None), (stranger, None)], {})


@pytest.mark.parametrize("written", ["muc-osl*2+lawnmower*2", "muc-osl*2", "muc-osl*3+lawnmower"])
def test_teams_of_another_size_than_the_scenario_are_refused(written: str) -> None:
    with pytest.raises(InputError, match=r"the scenario has team.n_uavs = 3"):
        evaluate(make_policy(written), small(action="waypoint"), [1], n_jobs=1, progress=False)


def test_members_that_command_differently_fly_what_they_share() -> None:
    mixed = team("surge-cast+random-walk")
    assert mixed.vehicle_commands == ("leg",)
    assert set(mixed.plume_quantities) == {"hit_rate", "concentration"}
    assert np.isfinite(evaluate(mixed, small(action="waypoint"), [1], n_jobs=1, progress=False)[0].energy)
