"""Observation features: bank and lone UAV agree, beliefs are Bayes', only the radio tells of teammates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from worlds import NOISY, advance, begun, flying, random_commands, small

from baselines import Briefing
from baselines.belief.grid import GridBelief
from baselines.belief.likelihood import hit_model
from baselines.features import (
    BeliefFeatures,
    FeatureBank,
    HitsFeatures,
    RawFeatures,
    SoloFeatures,
    TeamFeatures,
    make_spec,
    spec_hash,
    spec_names,
    spec_size,
    spec_slices,
)
from baselines.features.belief_kernels import exp32
from osl_env import Scenario, World
from osl_env.errors import InputError
from osl_env.observation import ObservationLayout

SPEC = make_spec([
    RawFeatures(neighbours=4), HitsFeatures(length=3), HitsFeatures(length=5, heard=True, detections_only=True),
    BeliefFeatures(particles=32), TeamFeatures(slots=3),
])  # fmt: skip
SCENARIOS = {
    "plain": small(),
    "alone": small(**{"team.n_uavs": 1}),
    "no radio": small(**{"radio.radius": 0.0}),
    "short radio": small(**{"radio.radius": 8.0}),
    "slow radio": small(**{"radio.latency": 7.5}),
    "noisy": small(**NOISY),
    "noisy wind": small(**{"anemometer.noise": 0.3}),
    "events": small(clock="event", action="waypoint"),
    "noisy events": small(**NOISY, clock="event", action="waypoint"),
    "velocities": flying(**NOISY),
    "wrong plume": small(advertised_plume={"source_strength": 5.0}),
    "short battery": small(**{"energy.capacity": 2500.0}),
}


def solos(world: World, env: int) -> list[SoloFeatures]:
    seed = int(world.episode["seed"][env])
    places = world.motion["position"][env]
    return [SoloFeatures(SPEC, Briefing.of(world.scenario, i, seed, places[i])) for i in range(world.n_uavs)]


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_lone_uav_observes_what_the_bank_shows(name: str) -> None:
    scenario, rng = SCENARIOS[name], np.random.default_rng(5)
    world, bank = begun(scenario, [3, 2**40]), FeatureBank(SPEC, scenario, 2)
    bank.reset()
    alone = [solos(world, env) for env in range(2)]
    silent = [[None] * world.n_uavs] * 2
    compared = 0
    for _ in range(60):
        rows = bank.update(world)
        assert np.isfinite(rows).all()
        assert np.abs(rows).max() <= 1.0
        inboxes = world.exchange(silent)
        deciding = world.running[:, None] & world.motion["active"] & world.motion["ready"]
        for env, uav in zip(*np.nonzero(deciding), strict=True):
            row = alone[env][uav].update(world.observation(env, uav), inboxes[env][uav])
            different = [n for n, a, b in zip(spec_names(SPEC), row, rows[env, uav], strict=True) if a != b]
            assert not different
            compared += 1
        if not world.running.any():
            break
        advance(world, random_commands(world, rng))
    assert compared > 8


def test_worlds_of_a_batch_do_not_touch_each_other() -> None:
    scenario = small(**NOISY)
    batch, single = begun(scenario, [1, 2, 3]), begun(scenario, 2)
    banks = FeatureBank(SPEC, scenario, 3), FeatureBank(SPEC, scenario, 1)
    for bank in banks:
        bank.reset()
    rng = np.random.default_rng(0)
    for step in range(12):
        rows, row = banks[0].update(batch), banks[1].update(single)
        np.testing.assert_array_equal(rows[1], row[0])
        actions = random_commands(batch, rng)[0]
        batch.step_hops(actions)
        single.step_hops(actions[1:2].copy())
        if step == 5:  # another world begins anew meanwhile
            mask = np.array([False, False, True])
            banks[0].update(batch)
            banks[1].update(single)
            batch.reset(np.array([0, 0, 9]), mask)
            banks[0].reset(mask)
            banks[0].update(batch, mask)
            batch.step_hops(actions)
            single.step_hops(actions[1:2].copy())


def test_raw_features_are_the_flat_observation() -> None:
    world = begun(small(), [1, 2])
    flat = world.layout.flat(world)
    spec = make_spec([{"kind": "raw", "neighbours": 2}])
    np.testing.assert_array_equal(FeatureBank(spec, world.scenario, 2).update(world), flat)
    wide = FeatureBank(make_spec([{"kind": "raw"}]), world.scenario, 2).update(world)
    np.testing.assert_array_equal(wide[..., : flat.shape[2]], flat)
    assert not wide[..., flat.shape[2] :].any()
    narrow = FeatureBank(make_spec([{"kind": "raw", "neighbours": 1}]), world.scenario, 2).update(world)
    np.testing.assert_array_equal(narrow, flat[..., : narrow.shape[2]])


@pytest.mark.parametrize("n_uavs", [1, 2, 5])
def test_the_size_does_not_depend_on_the_team(n_uavs: int) -> None:
    world = begun(small(**{"team.n_uavs": n_uavs}), [1])
    bank = FeatureBank(SPEC, world.scenario, 1)
    bank.reset()
    assert bank.update(world).shape == (1, n_uavs, spec_size(SPEC))
    team = bank.update(world)[0, 0, spec_slices(SPEC)[4]].reshape(3, -1)
    assert team[:, 0].sum() == min(n_uavs - 1, 3)
    assert not team[min(n_uavs - 1, 3) :].any()


def test_without_a_radio_nothing_is_known_of_teammates() -> None:
    """Locality: teammates that read other things change nothing."""
    scenario = small(**{"radio.radius": 0.0})
    worlds = [begun(scenario, 4), begun(scenario, 4)]
    banks = [FeatureBank(SPEC, scenario, 1) for _ in worlds]
    for bank in banks:
        bank.reset()
    for step in range(10):
        for world in worlds:
            world.step_hops(np.full((1, 3), 52))
        worlds[1].senses["reading"][0, 1:] += step  # as if the others had met more gas
        rows = [bank.update(world)[0, 0] for bank, world in zip(banks, worlds, strict=True)]
        np.testing.assert_array_equal(*rows)


def grid_of(scenario: Scenario, cell: float) -> GridBelief:
    belief = GridBelief(np.array(scenario.arena.size), cell=cell)
    belief.use_model(hit_model(scenario.plume, scenario.gas_sensor, np.array(scenario.wind.velocity)))
    return belief


def take(belief: GridBelief, rows: Any) -> None:
    """Bayes' rule on the grid for `rows` (F, 6)."""
    belief.update(rows[None, :, :3], rows[None, :, 3], rows[None, :, 4])


@pytest.mark.parametrize(("resample_below", "tolerance"), [(0.0, 0.15), (0.5, 0.6)])
def test_the_particle_belief_is_the_posterior(resample_below: float, tolerance: float) -> None:
    """Against a grid, to Monte Carlo error: with weights alone, and with resampling and roughening."""
    scenario = small(**{"team.n_uavs": 1, "plume.source_strength": 0.5})
    spec = make_spec([BeliefFeatures(particles=8192, resample_below=resample_below, roughening=0.2)])
    world, bank, rng = begun(scenario, 11), FeatureBank(spec, scenario, 1), np.random.default_rng(2)
    bank.reset()
    grid = grid_of(scenario, cell=0.5)
    for _ in range(8):
        bank.update(world)
        take(grid, bank._readings["heard"].rows[0, 0, :1])
        world.step_hops(random_commands(world, rng)[0])
    memory: Any = bank._features._memories[0]
    mean, covariance = grid.moments()
    moments = memory.moments[0, 0]
    np.testing.assert_allclose(moments[:3], mean[0], atol=tolerance)
    np.testing.assert_allclose(np.sqrt(moments[[3, 7, 11]]), np.sqrt(np.diag(covariance[0])), atol=tolerance)
    weighted = np.average(memory.clouds[0, 0, :3].T, axis=0, weights=memory.clouds[0, 0, 4])
    np.testing.assert_allclose(weighted, mean[0], atol=tolerance)


def test_the_prior_is_uniform_and_the_map_is_around_the_uav() -> None:
    scenario = small(**{"team.n_uavs": 1, "action": "velocity", "vehicle": {"kind": "point_mass"}})
    spec = make_spec([BeliefFeatures(particles=16384, inner_radius=4.0, outer_radius=8.0)])
    world, bank = begun(scenario), FeatureBank(spec, scenario, 1)
    bank.reset()  # in velocity mode nothing has been sampled yet
    row = dict(zip(spec_names(spec), bank.update(world)[0, 0].tolist(), strict=True))
    assert row["belief.entropy"] == pytest.approx(0.0, abs=1e-4)
    assert row["belief.silence"] == 1.0
    assert row["belief.offset.x"] == pytest.approx((10.0 - 4.0) / 20.0, abs=1e-3)
    spread = 20.0 / 12.0**0.5
    assert row["belief.spread.y"] == pytest.approx(spread / (spread + 10.0), abs=1e-3)
    cells = {name: value for name, value in row.items() if ".map." in name}
    assert sum(cells.values()) == pytest.approx(1.0, abs=1e-3)
    inner = sum(value for name, value in cells.items() if "inner" in name)
    assert inner == pytest.approx(np.pi * 4.0**2 / 400.0, abs=0.005)  # the UAV stands at (4, 4, 4)
    above = sum(value for name, value in cells.items() if "above" in name)
    assert above == pytest.approx(0.6, abs=0.005)
    eighth = np.pi * 4.0**2 / 8.0 / 400.0 * 0.4
    for octant in range(0, 360, 45):
        assert row[f"belief.map.inner.{octant}.below"] == pytest.approx(eighth, abs=0.003)
    assert row["belief.map.outer.45.above"] > 10 * row["belief.map.outer.225.above"]  # the area is on that side


def test_a_few_particles_stay_near_the_posterior() -> None:
    """Over 16 flights of a team: the mean of 64 particles is within the posterior's own spread."""
    scenario, seeds = small(), list(range(16))
    spec = make_spec([BeliefFeatures()])
    world, bank, rng = begun(scenario, seeds), FeatureBank(spec, scenario, 16), np.random.default_rng(1)
    bank.reset()
    grids = [grid_of(scenario, cell=1.0) for _ in seeds]
    for _ in range(15):
        rows = bank.update(world)
        for env, grid in enumerate(grids):
            take(grid, bank._readings["heard"].rows[env, 0, :3])
        advance(world, random_commands(world, rng))
    memory: Any = bank._features._memories[0]
    moments = [grid.moments() for grid in grids]
    means = np.array([mean[0] for mean, _ in moments])
    spreads = np.array([np.sqrt(np.trace(covariance[0])) for _, covariance in moments])
    distances = np.linalg.norm(memory.moments[:, 0, :3] - means, axis=1) / spreads
    assert np.median(distances) < 0.35
    assert np.max(distances) < 1.0
    widths = np.sqrt(memory.moments[:, 0, [3, 7, 11]].sum(axis=1)) / spreads
    assert 0.7 < np.median(widths) < 1.3
    assert (rows[..., spec_names(spec).index("belief.entropy")] < 0.0).all()


def test_single_precision_exponential() -> None:
    x = np.linspace(-86.0, 79.0, 100001, dtype=np.float32)
    values = np.array([exp32.py_func(v) for v in x[:100]], dtype=np.float64)
    np.testing.assert_allclose(values, np.exp(x[:100].astype(np.float64)), rtol=3e-7)


def test_names_hash_and_sizes() -> None:
    for feature in SPEC:
        assert len(set(feature.names)) == len(feature.names)
    assert len(spec_names(SPEC)) == spec_size(SPEC)
    layout = ObservationLayout(small(**{"team.n_uavs": 5}))
    assert spec_size(make_spec([RawFeatures(neighbours=4)])) == layout.flat_size
    assert spec_hash(SPEC) == spec_hash(make_spec([feature.model_dump() for feature in SPEC]))
    hashes = {spec_hash(make_spec([part])) for part in (*SPEC, RawFeatures(), BeliefFeatures(roughening=1.0))}
    assert len(hashes) == 7
    assert spec_slices(SPEC)[-1].stop == spec_size(SPEC)


@pytest.mark.parametrize(
    ("features", "said"),
    [
        ([{"kind": "smell"}], "smell"),
        ([{"kind": "hits", "lenght": 3}], "lenght"),
        ([{"kind": "belief", "particles": 10}], "particles"),
        ([], "at least one"),
        ("raw", "features"),
    ],
)
def test_a_wrong_spec_is_refused_in_one_line(features: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as refusal:
        make_spec(features)
    assert "\n" not in str(refusal.value)
