"""The whole state of a training in one file: safetensors for arrays, JSON in its header for the rest; no pickle.

Saved between two rollouts: weights, optimisers, replay buffer, counters, every generator, the environment with its
running episodes, and the trainer's own notes. So saving leaves no trace in a training, and one that goes on from the
file computes, on the same machine, bit by bit what it would have computed without a stop. The file is replaced at once
or not at all: a kill while it is written leaves the one before.
"""

from __future__ import annotations

import json
import os
import random
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.save_util import recursive_getattr

from osl_env.errors import InputError
from training.records import make_folder
from training.snapshot import Arrays, capture, decode, encode, restore

_FORMAT = "osl-training-1"
_COUNTERS = (
    "num_timesteps", "_episode_num", "_n_updates", "_n_calls", "exploration_rate", "_current_progress_remaining",
    "_last_obs", "_last_episode_starts", "ep_info_buffer", "ep_success_buffer",
)  # fmt: skip
_REPLAYED = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def save_state(path: Path, model: BaseAlgorithm, notes: dict[str, Any]) -> None:
    """Write the state of `model`, of its environment and of the generators, and `notes`, to `path`.

    Raises InputError if that cannot be written, TypeError if the environment holds what `training.snapshot` refuses.
    """
    arrays: Arrays = {}
    content = {
        "notes": notes,
        "learner": encode(_learner(model), arrays),
        "generators": encode(_generators(model), arrays),
        "scenarios": encode(_scenarios(model.env), arrays),
        "environment": capture(model.env, arrays),
    }
    make_folder(path.parent)
    part = path.with_name(f".{path.name}.part")
    try:
        save_file(arrays, part, metadata={"format": _FORMAT, "state": json.dumps(content)})
        with part.open("rb") as file:
            os.fsync(file.fileno())
        part.replace(path)
    except (OSError, SafetensorError) as error:
        raise InputError(f"{path}: cannot be written ({getattr(error, 'strerror', None) or error})") from None
    finally:
        part.unlink(missing_ok=True)


class SavedState:
    """A file of `save_state`, read."""

    def __init__(self, path: Path) -> None:
        """Raises InputError, in one line, for a file that is missing, truncated or of something else."""
        self._path = path
        try:
            with safe_open(path, framework="numpy") as file:
                about = file.metadata() or {}
                self._arrays: Arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except FileNotFoundError:
            raise InputError(f"{path}: no such file; there is no training to resume") from None
        except (OSError, SafetensorError) as error:
            raise InputError(f"{path}: is truncated, or no saved training ({error})") from None
        if about.get("format") != _FORMAT:
            raise InputError(f"{path}: is not a training saved by this version (format {about.get('format')!r})")
        self._content = json.loads(about["state"])

    @property
    def notes(self) -> dict[str, Any]:
        """What the trainer noted."""
        notes: dict[str, Any] = self._content["notes"]
        return notes

    def restore(self, model: BaseAlgorithm) -> None:
        """Bring a freshly made `model`, its environment and all generators into the saved state.

        Raises InputError if the model or the environment was made in another way.
        """
        env = model.env
        assert env is not None
        scenarios = decode(self._content["scenarios"], self._arrays)
        try:
            if scenarios is not None:
                env.load_state_dict(scenarios)  # type: ignore[attr-defined]
            env.reset()  # makes what an environment makes only then
            restore(env, self._content["environment"], self._arrays)
            _restore_learner(model, decode(self._content["learner"], self._arrays))
        except (ValueError, KeyError, RuntimeError) as error:
            raise InputError(f"{self._path}: is of another training or version ({error})") from None
        _restore_generators(model, decode(self._content["generators"], self._arrays))


def _scenarios(env: Any) -> Any:
    return env.state_dict() if hasattr(env, "state_dict") else None


def _learner(model: BaseAlgorithm) -> dict[str, Any]:
    modules, tensors = model._get_torch_save_params()
    counters = {name: getattr(model, name) for name in _COUNTERS if hasattr(model, name)}
    learner = {
        "modules": {name: dict(recursive_getattr(model, name).state_dict()) for name in modules},
        "tensors": {name: recursive_getattr(model, name) for name in tensors},
        "counters": counters,
        "memory": [list(pair) for pair in getattr(model, "_last_lstm_states", None) or ()],
    }
    if isinstance(model, OffPolicyAlgorithm):
        buffer: Any = model.replay_buffer
        used = buffer.buffer_size if buffer.full else buffer.pos
        learner["replay"] = {name: getattr(buffer, name)[:used] for name in _REPLAYED}
        learner["replay_position"] = [buffer.pos, buffer.full]
    return learner


def _restore_learner(model: Any, learner: dict[str, Any]) -> None:
    for name, content in learner["modules"].items():
        recursive_getattr(model, name).load_state_dict(content)
    for name, content in learner["tensors"].items():
        recursive_getattr(model, name).data.copy_(content)
    for name, value in learner["counters"].items():
        setattr(model, name, value)
    if learner["memory"]:
        pairs = (tuple(each.to(model.device) for each in pair) for pair in learner["memory"])
        model._last_lstm_states = type(model._last_lstm_states)(*pairs)
    if "replay" in learner:
        for name, rows in learner["replay"].items():
            getattr(model.replay_buffer, name)[: len(rows)] = rows
        model.replay_buffer.pos, model.replay_buffer.full = learner["replay_position"]


def _generators(model: BaseAlgorithm) -> dict[str, Any]:
    return {
        "python": random.getstate(),
        "numpy": np.random.get_state(legacy=False),  # noqa: NPY002 - SB3 draws from it
        "torch": torch.get_rng_state(),
        "cuda": torch.cuda.get_rng_state_all() if model.device.type == "cuda" else [],
        "actions": model.action_space.np_random,
    }


def _restore_generators(model: BaseAlgorithm, generators: dict[str, Any]) -> None:
    random.setstate(generators["python"])
    np.random.set_state(generators["numpy"])  # noqa: NPY002
    torch.set_rng_state(generators["torch"])
    if generators["cuda"] and model.device.type == "cuda":
        torch.cuda.set_rng_state_all(generators["cuda"])
    model.action_space.np_random.bit_generator.state = generators["actions"].bit_generator.state


@contextmanager
def untouched_generators(model: BaseAlgorithm) -> Iterator[None]:
    """What happens inside leaves no trace in the draws of the training."""
    arrays: Arrays = {}
    before = encode(_generators(model), arrays)
    try:
        yield
    finally:
        _restore_generators(model, decode(before, arrays))
