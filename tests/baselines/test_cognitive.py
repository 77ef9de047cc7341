"""Entrotaxis, Renyi and Bhattacharyya rewards against explicit posteriors, their laws, and what the searchers do."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.stats import poisson

from baselines import make_policy
from baselines.belief.grid import CENTRE_DISTANCE, GridBelief
from baselines.belief.grid_information import BIN_WIDTH
from baselines.belief.grid_rewards import poisson_powers, predictive_entropy, renyi_divergence
from baselines.belief.likelihood import hit_model
from baselines.cognitive import RewardSearch
from baselines.policy import Briefing, Policy
from osl_env import InputError, Scenario, load_scenario
from osl_env.actions import HOP_DIRECTIONS, Hop, Hover
from osl_env.observation import Observation
from osl_env.parameters import FloatArray
from osl_env.plumes.hit_rate import HitRatePlume
from osl_env.sensors import PoissonCounter
from osl_env.world import World
from training.flight import fly, run_batch

AREA = np.array([14.0, 10.0, 6.0])
WIND = (0.6, 0.8, 0.0)
MISS, FALSE_RATE = 0.1, 0.02
CANDIDATES = np.random.default_rng(5).uniform(0.0, AREA, (6, 3))
ORDERS = (0.05, 0.25, 0.5, 0.999, 1.001, 2.0, 4.0)
NAMES = ["entrotaxis", "infotaxis-renyi", "infotaxis-bhattacharyya"]
SMALL: dict[str, Any] = {
    "arena": {"size": [24, 18, 12]},
    "sources": {"positions": [[17, 13, 7]]},
    "team": {"n_uavs": 2, "starts": [[3, 3, 3], [8, 3, 3]]},
}


def small(**overrides: Any) -> Scenario:
    return load_scenario("rate-60x60x30", **(SMALL | overrides))


def belief_after(n_readings: int) -> GridBelief:
    """A belief after readings anywhere, zeros among them."""
    belief = GridBelief(AREA)
    sensor = PoissonCounter(false_positive_rate=FALSE_RATE, miss_probability=MISS)
    belief.use_model(hit_model(HitRatePlume(), sensor, np.array(WIND)))
    generator = np.random.default_rng(3)
    positions, hits = generator.uniform(0.0, AREA, (1, n_readings, 3)), generator.poisson(0.7, (1, n_readings))
    belief.update(positions, hits.astype(float), np.full((1, n_readings), 2.0))
    return belief


def mean_hits(belief: GridBelief, u: FloatArray, time: float) -> FloatArray:
    """Eq 1 of MUC-OSL written out for each cell."""
    plume, speed = HitRatePlume(), math.hypot(WIND[0], WIND[1])
    length = math.sqrt(plume.diffusivity * plume.lifetime / (1 + speed**2 * plume.lifetime / (4 * plume.diffusivity)))
    offset = u - np.array([belief.centre(c) for c in range(belief.n_cells)])
    distance = np.maximum(np.linalg.norm(offset, axis=1), max(0.5, CENTRE_DISTANCE * float(belief.size.mean())))
    rate = 2.5 / distance * np.exp(offset @ np.array(WIND) / (2 * plume.diffusivity) - distance / length)
    return np.asarray(((1.0 - MISS) * rate + FALSE_RATE) * time)


def explicit_divergence(belief: GridBelief, u: FloatArray, time: float, order: float) -> float:
    """E of D(posterior, prior) by forming the posterior of every outcome; order 1 is Kullback and Leibler's."""
    prior, mean, total = belief.probability[0], mean_hits(belief, u, time), 0.0
    for d in range(60):
        joint = prior * poisson.pmf(d, mean)
        p = joint.sum()
        if p < 1e-14:
            continue
        posterior = joint / p
        if order == 1.0:
            seen = posterior > 0.0
            total += p * np.sum(posterior[seen] * np.log(posterior[seen] / prior[seen]))
        else:
            total += p * math.log(np.sum(posterior**order * prior ** (1.0 - order))) / (order - 1.0)
    return total


def divergence(belief: GridBelief, time: float, order: float) -> FloatArray:
    return renyi_divergence(belief.compressed(), CANDIDATES, belief.models[0], time, order)


def blur(belief: GridBelief, time: float) -> FloatArray:
    """(6,) nats: alpha times this is what bins pretend to tell by blurring, to first order.

    Between two bins log lambda has a variance of up to width^2 / 4; the Fisher information about it is the mean m, and
    a small divergence is alpha / 2 times the product.
    """
    mean = [float(belief.probability[0] @ mean_hits(belief, u, time)) for u in CANDIDATES]
    return np.array(mean) * BIN_WIDTH**2 / 8.0


@pytest.mark.parametrize("n_readings", [0, 3, 12])
@pytest.mark.parametrize("time", [1.0, 4.0])
def test_rewards_are_those_of_explicit_posteriors(n_readings: int, time: float) -> None:
    belief = belief_after(n_readings)
    tolerance = blur(belief, time) + 2e-5  # 2e-5: outcomes left out on both sides, and higher orders
    entropies = predictive_entropy(belief.compressed(), CANDIDATES, belief.models[0], time)
    expected = np.empty(len(CANDIDATES))
    for i, u in enumerate(CANDIDATES):
        p = np.array([belief.probability[0] @ poisson.pmf(d, mean_hits(belief, u, time)) for d in range(60)])
        expected[i] = -np.sum(p[p > 0.0] * np.log(p[p > 0.0]))
    # the blur raises the mean by m / 2 times the variance, and the entropy by its slope times that: |ln m|, about 2
    assert (np.abs(entropies - expected) < 2.0 * tolerance).all()
    for order in (0.05, 0.5, 0.999, 2.0, 4.0):
        explicit = [explicit_divergence(belief, u, time, order) for u in CANDIDATES]
        assert (np.abs(divergence(belief, time, order) - explicit) < max(order, 1.0) * tolerance).all()


@pytest.mark.parametrize("n_readings", [0, 12])
def test_half_order_is_twice_the_bhattacharyya_distance(n_readings: int) -> None:
    belief = belief_after(n_readings)
    for u, value in zip(CANDIDATES, divergence(belief, 2.0, 0.5), strict=True):
        prior, distance = belief.probability[0], 0.0
        for d in range(60):
            joint = prior * poisson.pmf(d, mean_hits(belief, u, 2.0))
            if joint.sum() > 1e-14:
                distance -= joint.sum() * math.log(np.sum(np.sqrt(joint / joint.sum() * prior)))
        assert value == pytest.approx(2.0 * distance, abs=blur(belief, 2.0).max())


@pytest.mark.parametrize("n_readings", [0, 3, 25])
def test_divergence_grows_with_its_order_through_the_information(n_readings: int) -> None:
    """Exact for the binned belief: the slack is rounding's and that of outcomes left out (1e-9 of each law)."""
    belief = belief_after(n_readings)
    by_order = np.array([divergence(belief, 2.0, order) for order in ORDERS])
    assert (by_order >= 0.0).all()
    assert (np.diff(by_order, axis=0) >= -1e-9).all()
    information = belief.information(CANDIDATES, (2.0,))[:, 0]
    # D is smooth at alpha = 1: the mean of both sides is off by (1e-3)^2 times its curvature only
    np.testing.assert_allclose((by_order[3] + by_order[4]) / 2.0, information, rtol=1e-5, atol=1e-7)


def test_information_is_predictive_entropy_without_the_counters_own() -> None:
    """Infotaxis = Entrotaxis - the mean entropy of the Poisson laws: >= 0, so Entrotaxis' reward is the greater."""
    belief = belief_after(5)
    points = belief.compressed()
    entropy = predictive_entropy(points, CANDIDATES, belief.models[0], 1.0)
    own = [belief.probability[0] @ poisson(mean_hits(belief, u, 1.0)).entropy() for u in CANDIDATES]
    np.testing.assert_allclose(entropy - own, belief.information(CANDIDATES, (1.0,))[:, 0], rtol=2e-2, atol=2e-3)


def test_nothing_to_learn_is_worth_nothing() -> None:
    """The position known, or a sensor that smells nothing: no divergence; a counter's own noise stays in Entrotaxis."""
    known = belief_after(0)
    known.log_posterior[:] = -np.inf
    known.log_posterior[0, 7] = 0.0
    known.update(np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros((1, 1)))
    deaf = belief_after(0)
    deaf.use_model(hit_model(HitRatePlume(source_strength=1e-12), PoissonCounter(), np.array(WIND)))
    for order in ORDERS:
        # one cell lies between two bins, which the kernel tells apart a little (see test_one_cell of the grid belief)
        assert (divergence(known, 1.0, order) < 5e-3 * max(order, 1.0)).all()
        np.testing.assert_allclose(divergence(deaf, 1.0, order), 0.0, atol=1e-12)
    silent = predictive_entropy(deaf.compressed(), CANDIDATES, deaf.models[0], 1.0)
    assert (silent < 2e-5).all()  # rates end at 8e-7 a second: 8e-7 (1 - ln 8e-7) = 1.2e-5 nats
    noisy = predictive_entropy(known.compressed(), CANDIDATES, known.models[0], 1.0)
    np.testing.assert_allclose(noisy, [poisson(mean_hits(known, u, 1.0)[7]).entropy() for u in CANDIDATES], rtol=5e-3)


@pytest.mark.parametrize("order", [0.01, 20.0])
def test_strange_beliefs_stay_finite(order: float) -> None:
    """The extreme orders, with mass in cells of every rate, long samples and a still wind."""
    for wind in (np.zeros(3), np.array([0.0, -30.0, 0.0])):
        belief = GridBelief(AREA)
        belief.use_model(hit_model(HitRatePlume(source_strength=100.0), PoissonCounter(), wind))
        for time in (0.1, 60.0):
            reward = divergence(belief, time, order)
            assert np.isfinite(reward).all()
            assert (reward >= 0.0).all()
            assert (reward <= math.log(belief.n_cells) + 0.1).all()  # no posterior says more than which cell it is


def begun(policy: Policy, scenario: Scenario, seed: int = 4) -> Observation:
    """The first observation of UAV 0, with `policy` reset for it."""
    world = World(scenario)
    world.reset([seed])
    policy.reset(Briefing.of(scenario, 0, seed, world.motion["position"][0, 0]))
    return world.observation(0, 0)


def actions_of(policy: Policy, scenario: Scenario, seed: int, decisions: int) -> list[np.ndarray]:
    track: list[np.ndarray] = []
    fly(policy, scenario, [seed], max_decisions=decisions, watch=lambda w: track.append(w.motion["position"].copy()))
    return track


@pytest.mark.parametrize(
    "parameters", [{"reward": "entropy"}, {"reward": "renyi", "alpha": 1.0}, {"reward": "renyi", "alpha": 1.0 + 1e-9}]
)
def test_entropy_and_order_one_are_infotaxis(parameters: dict[str, Any]) -> None:
    for seed in range(2):
        expected = actions_of(make_policy("infotaxis"), small(), seed, 25)
        np.testing.assert_array_equal(
            actions_of(make_policy("infotaxis-renyi", **parameters), small(), seed, 25), expected
        )


def test_order_half_flies_as_bhattacharyya() -> None:
    halves = [make_policy("infotaxis-renyi", alpha=0.5), make_policy("infotaxis-bhattacharyya")]
    tracks = [actions_of(policy, small(), 3, 25) for policy in halves]
    np.testing.assert_array_equal(tracks[0], tracks[1])


@pytest.mark.parametrize("name", NAMES)
def test_hops_where_its_reward_is_greatest(name: str) -> None:
    policy = make_policy(name)
    observation = begun(policy, small())
    observation.reading = 1.0
    action = policy.act(observation, ())
    search = policy._search
    assert isinstance(search, RewardSearch)
    places = np.concatenate([observation.position + HOP_DIRECTIONS, observation.position[None]])
    reward = search.reward(places)
    chosen = len(HOP_DIRECTIONS) if isinstance(action, Hover) else action.direction
    assert reward[chosen] == pytest.approx(reward.max(), rel=1e-5)
    belief, plain = search.searcher.belief, np.empty(0)
    if name == "infotaxis-bhattacharyya":
        plain = 0.5 * renyi_divergence(belief.compressed(), places, belief.models[0], 1.0, 0.5)
    elif name == "infotaxis-renyi":
        plain = renyi_divergence(belief.compressed(), places, belief.models[0], 1.0, policy.alpha)
    else:
        plain = predictive_entropy(belief.compressed(), places, belief.models[0], 1.0)
    np.testing.assert_array_equal(reward, plain)


@pytest.mark.parametrize("name", NAMES)
def test_finds_a_source_and_is_a_function_of_the_seed(name: str) -> None:
    records = run_batch(make_policy(name), small(), range(3))
    assert sum(record.success for record in records) >= 2
    tracks = [actions_of(make_policy(name), small(), 11, 12) for _ in range(2)]
    np.testing.assert_array_equal(tracks[0], tracks[1])
    assert (np.array(tracks[0]) >= 0.0).all()
    assert (np.array(tracks[0]) <= [24, 18, 12]).all()


@pytest.mark.parametrize("name", NAMES)
def test_in_a_corner_only_hops_inside_and_the_hidden_source_is_hidden(name: str) -> None:
    actions = []
    for place in ([17, 13, 7], [2, 15, 9]):
        policy = make_policy(name, hovering=False)
        corner = small(team={"n_uavs": 2, "starts": [[0, 0, 0], [24, 18, 12]]}, sources={"positions": [place]})
        observation = begun(policy, corner)
        observation.reading = 0.0
        action = policy.act(observation, ())
        assert isinstance(action, Hop)
        assert (HOP_DIRECTIONS[action.direction] >= 0.0).all()
        actions.append(action)
    assert actions[0] == actions[1]


def test_bad_input_is_one_line() -> None:
    for name, wrong, words in (
        ("entrotaxis", {"alpha": 2.0}, "only with 'renyi'"),
        ("infotaxis-renyi", {"alpha": 0.0}, "alpha"),
        ("infotaxis-renyi", {"alpha": 21.0}, "alpha"),
        ("infotaxis-renyi", {"reward": "surprise"}, "reward"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            make_policy(name, **wrong)
        assert "\n" not in str(refused.value)
    belief = belief_after(0)
    with pytest.raises(ValueError, match=r"must be 0\.01 to 20"):
        poisson_powers(1.0, 0.0)
    with pytest.raises(ValueError, match="at its limit 1"):
        divergence(belief, 1.0, 1.0)
