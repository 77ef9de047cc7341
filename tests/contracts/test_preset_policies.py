"""Every preset is flown by every registered policy that fits it, and refuses the others in one line."""

from __future__ import annotations

import pytest

from baselines import make_policy, policy_class, policy_names
from osl_env import InputError, load_scenario, scenario_names
from training import evaluate

PRESETS = [name for name in scenario_names() if not name.endswith("-random")]
SEARCHERS = [name for name in policy_names() if name not in ("checkpoint", "sb3")]


def fits(policy: str, preset: str) -> bool:
    """As the classes say it."""
    scenario, searcher = load_scenario(preset), policy_class(policy)
    told = scenario.told_plume.measures if scenario.reports == "hits" else scenario.reports
    return told in searcher.plume_quantities


@pytest.mark.parametrize("preset", PRESETS)
def test_policies_that_fit_a_preset_fly_it(preset: str) -> None:
    n_uavs = min(3, load_scenario(preset).team.n_uavs)  # large teams take long, and show no more here
    short = load_scenario(preset, **{"ending.time_limit": 8.0, "team.n_uavs": n_uavs})
    flown = [name for name in SEARCHERS if fits(name, preset)]
    for name in flown:
        (record,) = evaluate(make_policy(name), short, seeds=[1], n_jobs=1, progress=False)
        assert record.scenario == preset
        assert record.energy > 0
        assert record.collisions == 0
    assert {"random-walk", "surge-cast"} <= set(flown)


@pytest.mark.parametrize("preset", PRESETS)
def test_policies_that_do_not_fit_a_preset_are_refused_in_one_line(preset: str) -> None:
    for name in SEARCHERS:
        if not fits(name, preset):
            with pytest.raises(InputError, match=f"policy {name} cannot search in scenario {preset}") as refused:
                evaluate(make_policy(name), preset, seeds=[1], n_jobs=1, progress=False)
            assert "\n" not in str(refused.value)
