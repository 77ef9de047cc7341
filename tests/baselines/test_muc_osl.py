"""MUC-OSL and its relatives: composition, messages, the equations of Col-PF and Adap-PP, determinism, locality."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np
import pytest

from baselines.belief.gaussian_fit import kl_divergence
from baselines.belief.likelihood import add_log_likelihood, hit_model
from baselines.belief.particle_filter import ParticleBelief
from baselines.declaration import DeclarationParameters, DeclarationRule
from baselines.muc_osl import col_pf_kernels as kernels
from baselines.muc_osl.col_pf import ColPF, ColPFParameters
from baselines.muc_osl.messages import pack_gaussian, pack_particles, unpack_gaussians, unpack_particles
from baselines.muc_osl.planners import AdaptivePlanner, InformationPlanner, length_from_zeta, plume_share
from baselines.muc_osl.planning_kernels import STAY, best_direction, best_length, place
from baselines.muc_osl.traditional import TraditionalFilter, pool_clouds
from baselines.policy import Briefing, Policy, make_policy
from osl_env.actions import HOP_DIRECTIONS, Hop
from osl_env.errors import InputError
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.radio import Message
from osl_env.scenario_files import load_scenario
from osl_env.sensors import PoissonCounter
from osl_env.world import World

SCENARIO = load_scenario("rate-60x60x30")
AREA = np.array(SCENARIO.arena.size, dtype=np.float64)
OPEN = np.ones(STAY + 1, np.int64)  # no obstacle is in the way of a hop
MODEL = hit_model(HitRatePlume(), PoissonCounter(), np.array([0.0, -1.0, 0.0]))
COMPOSITIONS = {
    "muc-osl": (ColPF, AdaptivePlanner),
    "col-pf": (ColPF, InformationPlanner),
    "adap-pp": (TraditionalFilter, AdaptivePlanner),
    "col-inf": (TraditionalFilter, InformationPlanner),
    "adap-pp-roughened": (TraditionalFilter, AdaptivePlanner),
    "col-inf-roughened": (TraditionalFilter, InformationPlanner),
}
PRINTED = [
    ("muc-osl", {"beta": "printed"}),
    ("muc-osl", {"environment_update": "printed"}),
    ("muc-osl", {"environment_update": "upwind"}),
    ("muc-osl", {"environment_update": "none"}),
    ("muc-osl", {"attraction": "sum", "attracted_share": 0.5}),
    ("muc-osl", {"attracted_share": 1.0}),
    ("muc-osl", {"count_rule": "recursion"}),
    ("muc-osl", {"count_rule": "fixed"}),
    ("muc-osl", {"redraw": "on_resampling"}),
    ("muc-osl", {"step": "from_zeta", "zeta_threshold": 0.3}),
    ("muc-osl", {"spread_weight": 30.0}),
    ("muc-osl", {"min_particles": None, "particles": 60}),
    ("col-pf", {"hop_length": 2}),
    ("col-inf", {"share_particles": False}),
    ("col-inf", {"resample_below": 1.0}),
    ("adap-pp", {"hovering": True, "roughening": 1.0}),
]


def _briefing(uav: int = 0, seed: int = 1) -> Briefing:
    return Briefing.of(SCENARIO, uav, seed, np.array([10.0, 10.0, 5.0]))


def _message(sender: int = 1, reading: float = 0.0, payload: bytes = b"", time: float = 0.0) -> Message:
    return Message(sender, time, np.array([20.0, 20.0, 5.0]), reading, 1.0, payload)


def _fly(policy: Policy, decisions: int, seed: int = 3) -> list[Any]:
    """The team's first actions with a plume that gives detections soon: [(action, payload, mean), ..]."""
    scenario = SCENARIO.override(plume={"source_strength": 20.0})
    world = World(scenario, 1)
    world.reset([seed])
    team = [copy.deepcopy(policy) for _ in range(world.n_uavs)]
    for i, member in enumerate(team):
        member.reset(Briefing.of(scenario, i, seed, world.motion["position"][0, i]))
    log: list[Any] = []
    for _ in range(decisions):
        seen = [world.observation(0, i) for i in range(world.n_uavs)]
        payloads = [member.broadcast(o) for member, o in zip(team, seen, strict=True)]
        inboxes = world.exchange([payloads])[0]
        targets = np.empty((1, world.n_uavs, 3))
        for i, member in enumerate(team):
            action = member.act(seen[i], inboxes[i])
            offset = action.length * HOP_DIRECTIONS[action.direction] if isinstance(action, Hop) else np.zeros(3)
            targets[0, i] = seen[i].position + offset
            belief = member.belief()
            assert belief is not None
            assert np.all(np.isfinite(belief.mean))
            assert (belief.particles >= 0.0).all()
            assert (belief.particles <= AREA).all()
            log.append((str(action), payloads[i], tuple(belief.mean)))
        world.step_waypoints(targets, np.ones((1, world.n_uavs), np.int64))
        if not world.running[0]:
            break
    return log


@pytest.mark.parametrize("name", sorted(COMPOSITIONS))
def test_algorithms_are_compositions(name: str) -> None:
    policy = make_policy(name)
    policy.reset(_briefing())
    estimator, planner = COMPOSITIONS[name]
    state = policy._state  # type: ignore[attr-defined]
    assert type(state.estimator) is estimator
    assert type(state.planner) is planner
    assert (getattr(policy, "roughening", 0.0) > 0.0) == name.endswith("roughened")


@pytest.mark.parametrize("name", sorted(COMPOSITIONS))
def test_same_episode_same_actions(name: str) -> None:
    assert _fly(make_policy(name), 12) == _fly(make_policy(name), 12)


@pytest.mark.parametrize(("name", "parameters"), PRINTED)
def test_every_reading_runs_and_makes_a_difference(name: str, parameters: dict[str, Any]) -> None:
    decisions = 40
    assert _fly(make_policy(name, **parameters), decisions) != _fly(make_policy(name), decisions)


def test_reset_forgets_and_the_seed_matters() -> None:
    world = World(SCENARIO, 1)
    world.reset([0])
    observation, policy = world.observation(0, 0), make_policy("muc-osl")
    means = []
    for seed in (1, 1, 2):
        policy.reset(_briefing(seed=seed))
        for _ in range(3):
            policy.act(observation, [])
        belief = policy.belief()
        assert belief is not None
        means.append(belief.mean)
    assert np.array_equal(means[0], means[1])
    assert not np.array_equal(means[0], means[2])


def test_actions_do_not_depend_on_where_the_source_is() -> None:
    """The same observations and frames give the same actions in a world whose source is elsewhere."""
    elsewhere = SCENARIO.override(sources={"positions": [[30.0, 40.0, 10.0]]})
    actions = []
    for scenario in (SCENARIO, elsewhere):
        world = World(scenario, 1)
        world.reset([5])
        observation = world.observation(0, 0)
        observation.reading, observation.sampling_time = 1.0, 1.0
        policy = make_policy("muc-osl")
        policy.reset(Briefing.of(scenario, 0, 5, observation.position))
        actions.append([policy.act(observation, [_message(reading=2.0)]) for _ in range(5)])
    assert actions[0] == actions[1]


@pytest.mark.parametrize("parameters", [{"particles": 1}, {"beta": "other"}, {"declare_spread": -1.0}, {"gamma": 2.0}])
def test_bad_parameters_are_refused(parameters: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="policy muc-osl"):
        make_policy("muc-osl", **parameters)


def test_messages_have_the_papers_sizes_and_come_back() -> None:
    belief = ParticleBelief(50, AREA, seed=1)
    gaussian, particles = pack_gaussian(belief.gaussian), pack_particles(belief.cloud)
    assert (len(gaussian), len(particles)) == (12 * 4, 50 * 4 * 4)
    received = unpack_gaussians([_message(payload=gaussian), _message(), _message(payload=b"123")])
    np.testing.assert_allclose(received[0], belief.gaussian, rtol=1e-6)
    assert np.isnan(received[1:]).all()
    frames = [_message(1, payload=particles, time=1.0), _message(2), _message(1, payload=particles[:160], time=2.0)]
    cloud, sent, sizes = unpack_particles(frames)
    assert (sent.tolist(), sizes.tolist()) == ([2.0], [10])  # the newest of each sender
    np.testing.assert_allclose(cloud[:, :3], belief.cloud[:3, :10].T, rtol=1e-6)
    assert unpack_gaussians([]).shape == (0, 12)


def test_beta() -> None:
    rng = np.random.default_rng(0)
    own = np.concatenate([rng.normal(size=3), np.diag([4.0, 5.0, 6.0]).ravel()])
    other = np.concatenate([own[:3] + 1.5, np.diag([2.0, 9.0, 4.0]).ravel()])
    neighbours = np.stack([own, other, np.full(12, np.nan)])
    powers = np.empty(3)
    kernels.sharing_powers(own, neighbours, True, powers)
    np.testing.assert_allclose(powers, [1.0, math.exp(-kl_divergence(own, other)), 1.0])
    kernels.sharing_powers(own, neighbours, False, powers)
    both = kl_divergence(own, other) + kl_divergence(other, own)
    np.testing.assert_allclose(powers, [1.0, math.exp(-both / 12.0), 1.0])


def test_attraction_point_is_the_mean_of_neighbours_with_detections() -> None:
    neighbours, point = np.zeros((3, 12)), np.empty(3)
    neighbours[:, :3] = [[10.0, 0.0, 0.0], [0.0, 20.0, 0.0], [99.0, 99.0, 99.0]]
    detected, powers = np.array([True, True, False]), np.array([0.25, 0.75, 1.0])
    assert kernels.attraction_point(neighbours, detected, powers, False, point)
    np.testing.assert_allclose(point, [2.5, 15.0, 0.0])
    powers[:] = 0.5
    assert kernels.attraction_point(neighbours, detected, powers, True, point)
    np.testing.assert_allclose(point, [5.0, 10.0, 0.0])
    assert not kernels.attraction_point(neighbours, np.zeros(3, bool), powers, False, point)


def _step(**changes: Any) -> kernels.Step:
    step = kernels.Step(0.0, False, 100.0, 20, 100, True, False, 1.0, kernels.JITTER, 1.0, 0.0, 1.0, 0.0, False)
    return step._replace(**changes)


def _moved(step: kernels.Step, count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Where particles were and are after a Col-PF iteration that says nothing."""
    belief = ParticleBelief(count, AREA, seed=2)
    before = belief.cloud[:3].copy()
    neighbours, detected = belief.gaussian[None].copy(), np.array([True])
    neighbours[0, :3] = AREA / 2.0
    cloud, _ = kernels.col_pf_update(
        belief.cloud, belief.gaussian, np.zeros((2, 6)), neighbours, detected, MODEL, step, AREA, belief.random
    )
    return before, cloud[:3]


def test_jitter_moves_a_share_by_a_metre() -> None:
    """Standard error of a standard deviation from n draws: 1 / sqrt(2 n); tolerance five of them, n about 300."""
    before, after = _moved(_step(moved_share=0.25))
    shift = after - before
    moved = np.any(shift != 0.0, axis=0)
    assert 85 <= moved.sum() <= 100  # 100 chosen; moves out of the area are rejected
    assert np.std(shift[:, moved]) == pytest.approx(1.0, abs=5.0 / math.sqrt(2 * 3 * 85) + 0.05)
    assert np.all((after >= 0.0) & (after <= AREA[:, None]))
    assert np.array_equal(*_moved(_step(moved_share=0.0)))


def test_upwind_and_printed_updates_go_upwind() -> None:
    before, after = _moved(_step(update=kernels.UPWIND))
    shift = after - before
    assert np.all(shift[[0, 2]] == 0.0)
    assert np.all((shift[1] >= 0.0) & (shift[1] <= 1.0))
    before, after = _moved(_step(update=kernels.PRINTED))
    assert np.all(after[1] >= before[1])
    assert np.all(after[1] <= 2.0 * before[1])
    assert (after - before)[1].max() > 1.0  # grows with the distance from the origin


def test_attraction_pulls_its_share_towards_the_neighbours() -> None:
    before, after = _moved(_step(update=kernels.NO_UPDATE, attracted_share=0.1))
    pulled = np.any(before != after, axis=0)
    assert pulled.sum() == 40
    goal = (AREA / 2.0)[:, None]
    assert np.all(np.linalg.norm(after - goal, axis=0)[pulled] < np.linalg.norm(before - goal, axis=0)[pulled])


def test_particle_count_follows_distance_and_cues() -> None:
    gaussian, reading = np.zeros(12), np.zeros(6)
    for distance, full in ((0.5, 100.0), (10.0, 100.0), (10.0, 40.0), (1e-9, 100.0), (50.0, 130.0)):
        gaussian[0] = distance
        expected = min(max(math.floor(full * math.exp(-1.0 / max(distance, 1e-3)) + 0.5), 20), 100)
        assert kernels.next_count(gaussian, reading, _step(full_count=full)) == expected
    gaussian[0] = 0.01
    assert kernels.next_count(gaussian, reading, _step(nearness=False)) == 100


def test_three_detections_in_a_row_cut_the_count_and_the_recursion_decays() -> None:
    hit = np.array([[12.0, 12.0, 5.0, 1.0, 1.0, 0.0]])
    silent = hit * [1, 1, 1, 0, 1, 1]
    counts: dict[str, list[int]] = {}
    for rule in ("from_initial", "recursion", "fixed"):
        estimator = ColPF(ColPFParameters(count_rule=rule), _briefing())
        readings = [silent] * 6 + [hit] * 3 + [silent] * 12
        counts[rule] = []
        for reading in readings:
            estimator.update(reading, [], MODEL)
            counts[rule].append(estimator.belief.count)
    assert set(counts["fixed"]) == {100}
    assert counts["from_initial"][5] > 90
    assert 45 < counts["from_initial"][9] <= 100 * (1.0 - 3 / 10)  # three detections in ten iterations, f_dist near 1
    assert counts["from_initial"][-1] > counts["from_initial"][9]
    assert counts["recursion"][-1] == 20


def test_moved_share_falls_to_nothing_at_the_last_iteration() -> None:
    estimator = ColPF(ColPFParameters(), _briefing())
    shares = []
    for k in (1, 200, 400, SCENARIO.ending.max_decisions, 10_000):
        estimator._iteration = k
        shares.append(estimator._step(MODEL).moved_share)
    assert shares[0] == pytest.approx(1.0, abs=1e-3)
    assert shares[2] == pytest.approx((1.0 - 0.5**1.8) ** 4, rel=1e-9)
    assert shares[3:] == [0.0, 0.0]
    assert sorted(shares, reverse=True) == shares


def _likelihood(belief: ParticleBelief, reading: np.ndarray) -> np.ndarray:
    log_likelihood = np.zeros(belief.count)
    add_log_likelihood(belief.x, belief.y, belief.z, log_likelihood, reading, 1.0, MODEL)
    return np.exp(log_likelihood)


def test_pooled_clouds_are_a_mixture_by_evidence() -> None:
    """What explains the reading better gets more of the pool; a cloud holds the readings before it was sent already."""
    own, other = ParticleBelief(80, AREA, seed=3), ParticleBelief(60, AREA, seed=4)
    reading = np.array([[25.0, 20.0, 10.0, 3.0, 1.0, 7.0]])
    particles = np.frombuffer(pack_particles(other.cloud), dtype=np.float32).reshape(-1, 4)
    weighted = own.weights * _likelihood(own, reading[0])
    for sent, likelihood in ((7.0, _likelihood(other, reading[0])), (9.0, np.ones(60))):
        pool = pool_clouds(own.cloud, np.log(weighted), particles, np.array([sent]), np.array([60]), reading, MODEL)
        expected = np.concatenate([weighted, other.weights * likelihood])
        np.testing.assert_allclose(pool[3], expected / expected.sum(), rtol=1e-4)


def test_best_length_counts_the_visits_in_each_sphere() -> None:
    rng = np.random.default_rng(0)
    position, mean = np.array([20.0, 20.0, 10.0]), np.array([45.0, 25.0, 10.0])
    for direction in range(0, 26, 5):
        history = position + rng.normal(size=(60, 3)) * 3.0
        scores = []
        for length in range(1, 7):
            spheres = []
            for reach in (length, length - 1):
                centre = position + 0.5 * reach * HOP_DIRECTIONS[direction]
                radius = 0.5 * reach * np.linalg.norm(HOP_DIRECTIONS[direction])
                spheres.append(np.sum(np.linalg.norm(history - centre, axis=1) <= radius))
            end = position + length * HOP_DIRECTIONS[direction]
            scores.append(np.linalg.norm(end - mean) + 2.0 * (spheres[0] - spheres[1]))
        chosen = best_length(position, direction, 1.0, 6, mean, history, 2.0, AREA)
        assert chosen == 1 + int(np.argmin(scores))


def test_legs_stay_in_the_area() -> None:
    corner, random = np.zeros(3), np.array([1], dtype=np.uint64)
    cloud = ParticleBelief(40, AREA, seed=1).cloud
    for _ in range(20):
        k = best_direction(cloud, corner, 1.0, False, 1.0, MODEL, 0.999, 1.0, 0.0, AREA, random, OPEN)
        assert min(HOP_DIRECTIONS[k]) >= 0.0
    up = 25
    assert best_length(AREA - 2.0, up, 1.0, 6, AREA, np.empty((0, 3)), 1.0, AREA) == 2
    nowhere = best_direction(cloud, corner, 500.0, False, 1.0, MODEL, 0.999, 1.0, 0.0, AREA, random, OPEN)
    assert nowhere == STAY
    assert place(corner, up, 2.0) == (2.0, 2.0, 2.0)


def test_a_collapsed_cloud_gives_no_preference() -> None:
    """All directions tie in information: they are chosen evenly, not the first one always."""
    cloud = ParticleBelief(30, AREA, seed=1).cloud
    cloud[:3] = np.array([[40.0], [40.0], [20.0]])
    random, centre = np.array([1], dtype=np.uint64), np.array([20.0, 20.0, 10.0])
    chosen = {
        best_direction(cloud, centre, 1.0, False, 1.0, MODEL, 0.999, 1.0, 0.0, AREA, random, OPEN) for _ in range(200)
    }
    assert len(chosen) > 20


def test_adaptive_planner_goes_to_a_certain_estimate() -> None:
    cloud = ParticleBelief(30, AREA, seed=1).cloud
    cloud[:3] = np.array([[40.0], [20.0], [10.0]])
    random, centre = np.array([1], dtype=np.uint64), np.array([20.0, 20.0, 10.0])
    k = best_direction(cloud, centre, 1.0, False, 1.0, MODEL, 0.999, 0.0, 1.0, AREA, random, OPEN)
    assert HOP_DIRECTIONS[k].tolist() == [1.0, 0.0, 0.0]


def test_longest_step_from_zeta() -> None:
    assert [length_from_zeta(z) for z in (0.5, 0.1, 0.05, 0.02, 0.0)] == [1, 1, 2, 5, 100]
    shares = [plume_share(_briefing(), threshold) for threshold in (0.05, 0.1, 0.5)]
    assert 0.0 < shares[2] < shares[1] < shares[0] < 1.0


def test_declaration_needs_a_detection_a_small_spread_and_to_be_near() -> None:
    mean, near, far = np.array([5.0, 5.0, 5.0]), np.array([5.0, 7.5, 5.0]), np.array([5.0, 8.5, 5.0])
    rule = DeclarationRule(DeclarationParameters())
    rule.hear(0.0)
    assert rule.decide(mean, 1.0, near) is None
    rule.hear(1.0)
    assert rule.decide(mean, 2.0, near) is None
    assert rule.decide(mean, 1.0, far) is None
    declared = rule.decide(mean, 1.9, near)
    assert declared is not None
    assert declared is not mean
    np.testing.assert_array_equal(declared, mean)
    assert DeclarationRule(DeclarationParameters(declare_distance=4.0)).heard is False
