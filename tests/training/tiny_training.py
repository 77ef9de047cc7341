"""Trainings of a second, for tests."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import yaml

from training.training_config import TrainingConfig, make_config

EASY = {"team.n_uavs": 2, "ending.max_decisions": 5}
FLYING = EASY | {"vehicle": {"kind": "point_mass"}, "action": "velocity"}
STEERING = FLYING | {"action": "setpoint"}
ON_POLICY = {"n_steps": 4, "batch_size": 24, "n_epochs": 2, "learning_rate": 1e-2, "final_learning_rate": 0.0}
OFF_POLICY = {"buffer_size": 240, "learning_starts": 24, "batch_size": 8}
TEAM = [{"kind": "belief", "particles": 16}, {"kind": "team", "slots": 3}, {"kind": "hits", "length": 2}]
RANDOMISED: dict[str, Any] = {
    "scenario": "rate-60x60x30-random",
    "groups": 3,
    "vary": {
        "team.n_uavs": {"choices": [1, 2]},
        "wind.speed": [0.5, 2.0],
        "radio.radius": {"choices": [20.0, math.inf]},
        "starts": {"choices": ["corner"]},
    },
    "curriculum": [{"until": 0.5, "vary": {"team.n_uavs": {"choices": [1]}, "starts": {"choices": ["anywhere"]}}}],
    "redraw": 0.5,
    "redraw_every": 5,
}

KINDS: dict[str, dict[str, Any]] = {
    "ppo": {"algorithm": {"kind": "ppo", **ON_POLICY}},
    "ppo-team": {
        "algorithm": {"kind": "ppo", **ON_POLICY},
        "network": {"kind": "team", "embedding": 4, "layers": [8]},
        "environment": {"features": TEAM},
    },
    "ppo-randomised": {
        "algorithm": {"kind": "ppo", **ON_POLICY},
        "environment": {
            "kind": "uav",
            "overrides": EASY,
            "n_worlds": 3,
            "features": TEAM,
            "randomisation": RANDOMISED,
        },
    },
    "recurrent-ppo": {
        "algorithm": {"kind": "recurrent-ppo", **ON_POLICY},
        "network": {"kind": "lstm", "memory": 6, "layers": [8]},
    },
    "dqn": {"algorithm": {"kind": "dqn", **OFF_POLICY, "target_update_interval": 12, "exploration_fraction": 0.5}},
    "sac": {
        "algorithm": {"kind": "sac", **OFF_POLICY, "gradient_steps": 2},
        "environment": {"overrides": FLYING},
        "evaluation": {"overrides": FLYING},
    },
    "ppo-setpoint": {
        "algorithm": {"kind": "ppo", **ON_POLICY},
        "environment": {"overrides": STEERING},
        "evaluation": {"overrides": STEERING},
    },
}


def content(kind: str = "ppo", **changes: Any) -> dict[str, Any]:
    """A tiny training, as a file holds it: 3 worlds of 2 UAVs, so 6 slots."""
    blocks: dict[str, Any] = {
        "name": f"tiny-{kind}",
        "steps": 144,
        "environment": {"kind": "uav", "scenarios": ["rate-60x60x30-random"], "overrides": EASY, "n_worlds": 3},
        "network": {"kind": "mlp", "layers": [8]},
        "evaluation": {"scenario": "rate-60x60x30", "overrides": EASY, "seeds": {"count": 2}, "every": 72},
        "checkpoints": {"every": 48},
    }
    for name, block in KINDS[kind].items():
        fresh = "kind" in block
        blocks[name] = block if fresh else blocks[name] | block
    return blocks | changes


def config(kind: str = "ppo", **changes: Any) -> TrainingConfig:
    return make_config(content(kind, **changes))


def config_file(folder: Path, **changes: Any) -> Path:
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(content(**changes)))
    return path
