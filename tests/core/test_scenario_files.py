"""Scenario files: what is wrong is said in one line (file, key, value, limit); units convert; hashes tell."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from osl_env import InputError, Scenario, World, load_scenario, scenario_names

Write = Callable[[str], Path]
PRESET = "rate-60x60x30"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(text: str) -> Path:
        path = tmp_path / "mine.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def refusal(scenario: Any, **overrides: Any) -> str:
    with pytest.raises(InputError) as caught:
        World(load_scenario(scenario, **overrides))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 800  # a line for each of the presets would be more
    return message


# text of a file -> what its refusal must name besides the file
BAD_FILES: dict[str, tuple[str, ...]] = {
    "arena: {size: [60, 60, .nan]}": ("arena", "size", "nan", "finite"),
    "arena: {size: [60, 60, .inf]}": ("arena", "size", "inf", "finite"),
    "arena: {size: [60, -60, 30]}": ("arena", "size", "-60", "above 0"),
    "arena: {size: [60, 0, 30]}": ("arena", "size", "above 0"),
    "arena: {size: [60, 60]}": ("arena.size",),
    "arena: {size: 60}": ("arena.size", "60"),
    "arena: 7": ("arena", "7"),
    "plume: {diffusivity: 0}": ("plume.diffusivity", "0", "greater than 0"),
    "plume: {diffusivity: -1}": ("plume.diffusivity", "-1", "greater than 0"),
    "plume: {lifetime: .nan}": ("plume.lifetime", "nan", "finite"),
    "plume: {lifetime: .inf}": ("plume.lifetime", "inf", "finite"),
    "plume: {lifetime: true}": ("plume.lifetime", "True", "truth value"),
    "plume: {lifetime: [1]}": ("plume.lifetime",),
    "plume: {lifetime: }": ("plume.lifetime",),
    "plume: {lifetime: {a: 1}}": ("plume.lifetime",),
    "plume: {lifetime: soon}": ("plume.lifetime", "soon", "s"),
    "plume: {lifetime: 5 m}": ("plume.lifetime", "5 m", "s"),
    "plume: {lifetime: 5 parsnips}": ("plume.lifetime", "5 parsnips", "parsnips"),
    "plume: {lifetime: '5 s)'}": ("plume.lifetime", "5 s)"),
    'plume: {lifetime: "5\\ns\\n("}': ("plume.lifetime",),
    "plume: {kind: gaussian}": ("plume.kind", "gaussian", "hit_rate"),
    "plume: {colour: red}": ("unknown key", "plume.colour"),
    "plumes: {}": ("unknown key", "plumes"),
    "team: {n_uavs: 0}": ("team.n_uavs", "0", "greater than or equal to 1"),
    "team: {n_uavs: -3}": ("team.n_uavs", "-3"),
    "team: {n_uavs: 2.5}": ("team.n_uavs", "2.5"),
    "team: {n_uavs: 100000}": ("team.n_uavs", "100000", "1024"),
    "team: {n_uavs: 9}": ("n_uavs = 9", "8 starts"),
    "team: {n_uavs: true}": ("team.n_uavs", "True", "truth value"),
    "team: {n_uavs: many}": ("team.n_uavs", "many"),
    "team: {starts: [[61, 1, 1]], n_uavs: 1}": ("team.starts", "61", "[0, 60]"),
    "team: {starts: [[1, 1, -0.1]], n_uavs: 1}": ("team.starts", "-0.1", "[0, 30]"),
    "team: {starts: []}": ("starts",),
    "team: {region: [[0, 0, 0], [61, 1, 1]]}": ("team.region", "61", "[0, 60]"),
    "team: {region: [[5, 0, 0], [1, 1, 1]]}": ("team", "region", "low corner"),
    "sources: {positions: [[48, 49.8, 31]]}": ("sources.positions", "31", "[0, 30]"),
    "sources: {positions: []}": ("sources.positions", "1"),
    "sources: {positions: [[1, 2]]}": ("sources.positions",),
    "sources: {region: [[0, 0, 0], [60, 60, 31]]}": ("sources.region", "31", "[0, 30]"),
    "sources: {region: [[0, 0, 0], [60, 60, 30]], number: 0}": ("sources.number", "0"),
    "sources: {region: [[0, 0, 0], [60, 60, 30]], number: 65}": ("sources.number", "65", "64"),
    "sources: {region: [[9, 9, 4], [12, 12, 6]], minimum_distance: 40}": ("sources.minimum_distance", "40"),
    "sources: {strengths: [1, 2]}": ("strengths", "[1.0, 2.0]", "1 sources"),
    "sources: {strengths: [0]}": ("strengths", "above 0"),
    "wind: {velocity: [0, 1, 1]}": ("velocity", "horizontal"),
    "wind: {velocity: [0, 1, .nan]}": ("velocity", "finite"),
    "wind: {random_direction: 17}": ("wind.random_direction", "17"),
    "vehicle: {speed: 0}": ("speed", "0", "greater than 0"),
    "vehicle: {speed: 36 kg}": ("speed", "36 kg", "m/s"),
    "vehicle: {kind: submarine}": ("vehicle", "submarine", "grid_hop"),
    "vehicle: {kind: point_mass, physics_step: 0.3}": ("physics_step", "0.3", "decision_period"),
    "vehicle: {hop_lengths: 101}": ("hop_lengths", "101", "100"),
    "vehicle: {max_samples: 1000000000000000000000000000000}": ("max_samples",),
    "action: jump": ("action", "jump", "hop"),
    "action: velocity": ("action", "velocity", "grid_hop"),
    "clock: cuckoo": ("clock", "cuckoo", "barrier"),
    "energy: {capacity: 0}": ("energy.capacity", "0", "greater than 0"),
    "energy: {capacity: 5 m}": ("energy.capacity", "5 m", "J"),
    "radio: {radius: -1}": ("radio.radius", "-1"),
    "radio: {radius: .nan}": ("radio.radius", "nan"),
    "radio: {radius: -.inf}": ("radio.radius", "-inf"),
    "radio: {loss: 1}": ("radio.loss", "1", "less than 1"),
    "radio: {latency: 61}": ("radio.latency", "61", "60"),
    "gas_sensor: {miss_probability: 1.5}": ("gas_sensor.miss_probability", "1.5", "less than 1"),
    "ending: {success: maybe}": ("ending.success", "maybe", "declare"),
    "ending: {time_limit: 0 min}": ("ending.time_limit", "0", "greater than 0"),
    "ending: {max_decisions: 0}": ("ending.max_decisions", "0"),
    "ending: {max_decisions: 1000000000000000000000000000000}": ("ending.max_decisions",),
    "reward: {discount: 1.1}": ("reward.discount", "1.1", "less than or equal to 1"),
    "reward: {shaping: -1}": ("reward.shaping", "-1"),
    "max_neighbours: -1": ("max_neighbours", "-1"),
    "max_neighbours: 65": ("max_neighbours", "65", "64"),
    "name: [1]": ("name",),
    "base: [1]": ("base", "[1]"),
    "base: no-such-scenario": ("no-such-scenario",),
    "base: missing.yaml": ("missing.yaml",),
    "base: mine.yaml": ("base", "loop"),
    "- 1\n- 2": ("mapping", "list"),
    "just words": ("mapping", "str"),
    "": ("mapping", "NoneType"),
    "1: 2": ("mapping",),
    "arena: {size: [1, 2": ("line", "is not YAML"),
    "a: b: c": ("line 2", "is not YAML"),
    "\tarena: {}": ("is not YAML",),
    "a: !!python/object/apply:os.getcwd []": ("is not YAML",),
    "a: &a [*a]": ("a",),
}


@pytest.mark.parametrize("text", BAD_FILES)
def test_a_bad_file_is_refused_in_one_line_that_says_where_and_why(write: Write, text: str) -> None:
    header = "" if text in ("", "- 1\n- 2", "just words", "1: 2") or "base" in text else f"base: {PRESET}\n"
    path = write(header + text)
    message = refusal(path)
    for part in BAD_FILES[text]:
        assert part in message
    if "base: no-such" not in text and "base: missing" not in text:
        assert "mine.yaml" in message


def test_a_number_too_large_for_its_unit_is_refused_quickly(write: Write) -> None:
    assert "lifetime" in refusal(write("plume: {lifetime: '10**10**10 s'}"))
    assert "lifetime" in refusal(write("plume: {lifetime: 1e999}"))


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    assert "mine.yaml" in refusal(path)


def test_a_huge_file_is_refused(write: Write) -> None:
    assert "larger than" in refusal(write("# x\n" * 400_000))


def test_a_folder_is_not_a_scenario(tmp_path: Path) -> None:
    assert str(tmp_path) in refusal(tmp_path)


@pytest.mark.parametrize("name", ["rate-60x60x3", "nowhere", "", "../scenarios/rate-60x60x30", "nothing.yaml"])
def test_unknown_names_are_refused(name: str) -> None:
    message = refusal(name)
    if name == "rate-60x60x3":
        assert "did you mean 'rate-60x60x30'?" in message
    if name in ("nowhere", "rate-60x60x3"):
        assert all(preset.removesuffix("-random") in message for preset in scenario_names())
        assert "also with -random" in message


@pytest.mark.parametrize("scenario", [7, None, ["rate-60x60x30"], np.zeros((40, 3))])
def test_things_that_are_no_scenario_are_refused(scenario: Any) -> None:
    assert "name, a path or a Scenario" in refusal(scenario)


@pytest.mark.parametrize(
    "overrides",
    [
        {"team": 5},
        {"team.n_uavs.more": 1},
        {"nothing": 1},
        {"team.": 1},
        {".n_uavs": 1},
        {"arena.size": np.zeros((30, 3))},
        {"arena.size": "\n"},
        {"plume": None},
        {"ending.time_limit": "1\nparsnip"},
        {"name": "a\nb", "team.n_uavs": 0},
        {"sources.positions": [[1e308, 1e308, 1e308]]},
    ],
)
def test_bad_overrides_are_refused_in_one_line(overrides: dict[str, Any]) -> None:
    assert PRESET in refusal(PRESET, **overrides)
    refusal(load_scenario(PRESET), **overrides)


@pytest.mark.parametrize("n_envs", [0, -1, 1.5, True, "3", 10**12])
def test_bad_batch_sizes_are_refused(n_envs: Any) -> None:
    with pytest.raises(InputError, match=r"^n_envs = ") as caught:
        World(PRESET, n_envs)
    assert "\n" not in str(caught.value)


def test_a_radio_queue_too_large_for_memory_is_refused() -> None:
    changes = {"team.region": [[0, 0, 0], [60, 60, 30]], "team.n_uavs": 1024, "radio.latency": 60, "clock": "event"}
    assert "GiB" in refusal(PRESET, **changes)


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("ending.time_limit", "20 min", 1200.0),
        ("ending.time_limit", "0.5 hour", 1800.0),
        ("vehicle.speed", "36 km/h", 10.0),
        ("radio.radius", "2 km", 2000.0),
        ("radio.radius", "inf", float("inf")),
        ("energy.capacity", "1 kWh", 3.6e6),
        ("radio.bit_rate", "1 Mbit/s", 1e6),
        ("plume.diffusivity", "50 cm^2/s", 0.005),
        ("ending.time_limit", "1e3", 1000.0),
        ("ending.time_limit", 1000, 1000.0),
    ],
)
def test_units_convert(key: str, text: Any, value: float) -> None:
    scenario: Any = load_scenario(PRESET, **{key: text})
    for name in key.split("."):
        scenario = getattr(scenario, name)
    assert scenario == pytest.approx(value, rel=1e-12)


def test_vectors_may_mix_units_and_numbers() -> None:
    assert load_scenario(PRESET, **{"arena.size": ["0.06 km", 60, "3000 cm"]}).arena.size == pytest.approx(
        (60.0, 60.0, 30.0)
    )


def test_a_file_names_its_base_and_its_differences(write: Write) -> None:
    scenario = load_scenario(write(f"base: {PRESET}\nradio: {{radius: 20 m}}\nteam: {{n_uavs: 2}}\n"))
    assert (scenario.name, scenario.radio.radius, scenario.team.n_uavs) == ("mine", 20.0, 2)
    assert scenario.arena == load_scenario(PRESET).arena


def test_another_kind_of_model_does_not_inherit_the_parameters_of_the_first(write: Write) -> None:
    scenario = load_scenario(write(f"base: {PRESET}\nvehicle: {{kind: point_mass}}\n"))
    assert scenario.vehicle.kind == "point_mass"
    assert scenario.vehicle.hop_lengths == 1


PHYSICS = [
    {"arena.size": (60, 60, 31)},
    {"team.n_uavs": 2},
    {"team.starts": [(1, 1, 1)] * 3},
    {"sources.positions": [(1, 2, 3)]},
    {"sources.strengths": [2.0]},
    {"plume.lifetime": 99},
    {"wind.velocity": (0, -1.1, 0)},
    {"wind.random_direction": True},
    {"vehicle.hop_lengths": 5},
    {"vehicle.kind": "point_mass"},
    {"energy.capacity": 1e5},
    {"gas_sensor.dead_time": 0.1},
    {"anemometer.noise": 0.1},
    {"radio.radius": 9},
    {"ending.time_limit": 60},
    {"reward.time": 0},
    {"clock": "event"},
    {"action": "waypoint"},
    {"max_neighbours": 1},
    {"advertised_plume": {"lifetime": 50}},
]


def test_the_hash_changes_with_everything_that_changes_an_episode() -> None:
    hashes = {load_scenario(PRESET, **change).hash for change in PHYSICS} | {load_scenario(PRESET).hash}
    assert len(hashes) == len(PHYSICS) + 1


@pytest.mark.parametrize(
    "change", [{}, {"name": "x"}, {"description": "y"}, {"ending.time_limit": "20 min"}, {"arena.size": [60.0, 60, 30]}]
)
def test_the_hash_does_not_change_with_words_or_notation(change: dict[str, Any]) -> None:
    scenario = load_scenario(PRESET, **change)
    assert scenario.hash == load_scenario(PRESET).hash
    assert len(scenario.hash) == 12
    assert int(scenario.hash, 16) >= 0


def test_a_scenario_survives_a_round_trip_and_is_frozen() -> None:
    scenario = load_scenario(PRESET, **{"radio.radius": 20, "advertised_plume": {"lifetime": 50}})
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    assert Scenario.model_validate(scenario.model_dump()).hash == scenario.hash
    with pytest.raises(ValueError, match="frozen"):
        scenario.clock = "event"  # type: ignore[misc]


def test_the_simulators_plume_is_not_the_advertised_one() -> None:
    scenario = load_scenario(PRESET, advertised_plume={"source_strength": 100.0})
    world, plain = World(scenario), World(PRESET)
    world.reset([1])
    plain.reset([1])
    assert np.array_equal(world.rates, plain.rates)
