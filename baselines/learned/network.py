"""Forward passes of trained networks in numpy and compiled loops: what flies a checkpoint where there is no torch.

    features -> (team: attention or pooling over the neighbours' entries) -> (LSTM) -> hidden layers -> head

covers the actors of PPO, RecurrentPPO, SAC and the Q network of DQN as Stable-Baselines3 builds them from their default
policies, and with the team extractor of `training.networks`. Everything is float32, and a row's result does not depend
on the batch that it is part of (see `dense`). The tests compare with torch to 1e-5.

Heads: `logits` (PPO, one number an action), `values` (DQN, likewise), `gaussian` (PPO, mean, clipped to [-1, 1]),
`squashed` (SAC, tanh of the mean).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError, model_validator

from baselines.learned.dense import (
    RELU,
    TANH,
    Float32Array,
    MaskArray,
    activate,
    attend,
    dense,
    lstm_cell,
    pool_max,
    pool_mean,
)
from osl_env.errors import InputError
from osl_env.parameters import Parameters, one_line, quantity

_ACTIVATIONS = {"tanh": TANH, "relu": RELU}
LOG_STD_LIMITS = (-20.0, 2.0)  # of SAC


class TeamSizes(Parameters):
    """The team extractor: `slots` entries of `slot_size` numbers from column `start` of the features on.

    The first number of an entry is its mask (above 0.5: there is such a neighbour). Everything before and after the
    entries is the UAV's own. Pooling does not depend on the order or number of neighbours.
    """

    start: int = quantity(..., "", ge=0)
    slots: int = quantity(..., "", ge=1)
    slot_size: int = quantity(..., "", ge=2)
    embedding: int = quantity(64, "", ge=1)
    pooling: Literal["attention", "mean", "max"] = "attention"


class LstmSizes(Parameters):
    """Stacked LSTM layers of `size` units each."""

    size: int = quantity(..., "", ge=1)
    layers: int = quantity(1, "", ge=1, le=8)
    beside: bool = False  # what goes into the memory stands beside what comes out


class Architecture(Parameters):
    """The shape of a network, as `architecture` in a checkpoint says it."""

    kind: Literal["mlp", "lstm", "team"]
    inputs: int = quantity(..., "", ge=1)
    team: TeamSizes | None = None
    lstm: LstmSizes | None = None
    hidden: tuple[int, ...] = quantity((), "")
    activation: Literal["tanh", "relu"] = "tanh"
    outputs: int = quantity(..., "", ge=1)
    head: Literal["logits", "values", "gaussian", "squashed"]

    @model_validator(mode="after")
    def _consistent(self) -> Architecture:
        if any(width < 1 for width in self.hidden):
            raise ValueError(f"hidden = {list(self.hidden)}: must be numbers of at least 1")
        if (self.kind == "team") != (self.team is not None) or (self.kind == "lstm" and self.lstm is None):
            raise ValueError(f"kind = {self.kind!r}: needs the sizes under its own name, and no team's otherwise")
        if self.kind == "mlp" and self.lstm is not None:
            raise ValueError("kind = 'mlp': takes no lstm")
        if self.team is not None and self.team.start + self.team.slots * self.team.slot_size > self.inputs:
            raise ValueError(f"team: its entries end beyond the {self.inputs} inputs")
        return self

    @classmethod
    def parse(cls, content: Mapping[str, Any], where: str) -> Architecture:
        """The architecture that the mapping `content` says. Raises InputError naming `where`."""
        try:
            return cls.model_validate(dict(content))
        except ValidationError as error:
            raise one_line(error, f"{where}: architecture") from None

    @property
    def extracted(self) -> int:
        """Numbers that leave the extractor."""
        return self.inputs if self.team is None else 2 * self.team.embedding

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Name -> shape of every array of weights, (outputs, inputs) as in torch."""
        shapes: dict[str, tuple[int, ...]] = {}
        width = self.extracted
        if self.team is not None:
            size, entry = self.team.embedding, self.team.slot_size - 1
            shapes |= _layer("team.own", self.inputs - self.team.slots * self.team.slot_size, size)
            shapes |= _layer("team.entry", entry, size)
            if self.team.pooling == "attention":
                shapes |= {f"team.{name}.weight": (size, size) for name in ("query", "key", "value")}
        if self.lstm is not None:
            for layer in range(self.lstm.layers):
                gates = 4 * self.lstm.size
                shapes |= _layer(f"lstm.{layer}.input", width, gates)
                shapes[f"lstm.{layer}.hidden.weight"] = (gates, self.lstm.size)
                width = self.lstm.size
            width += self.extracted if self.lstm.beside else 0
        for number, size in enumerate(self.hidden):
            shapes |= _layer(f"hidden.{number}", width, size)
            width = size
        shapes |= _layer("action", width, self.outputs)
        if self.head == "gaussian":
            shapes["log_std"] = (self.outputs,)
        elif self.head == "squashed":
            shapes |= _layer("log_std", width, self.outputs)
        return shapes


def _layer(name: str, inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


class Network:
    """A network with its weights: immutable, so that copies of a policy share it."""

    def __init__(self, architecture: Architecture, arrays: Mapping[str, Float32Array], where: str = "network") -> None:
        """Raises InputError naming `where` if `arrays` are not those of `architecture`."""
        self.architecture = architecture
        _check(architecture.shapes(), arrays, where)
        # weights as (inputs, outputs): the inner loop then runs along rows
        self._arrays = {name: np.ascontiguousarray(array.T, dtype=np.float32) for name, array in arrays.items()}
        self.n_parameters = sum(array.size for array in self._arrays.values())
        self._activation = _ACTIVATIONS[architecture.activation]
        self._own_columns = _own_columns(architecture)

    def __deepcopy__(self, memo: dict[int, Any]) -> Network:
        return self

    @property
    def state_size(self) -> int:
        """Numbers that a row carries from one decision to the next: hidden and cell of each LSTM layer."""
        lstm = self.architecture.lstm
        return 0 if lstm is None else 2 * lstm.layers * lstm.size

    def start(self, n: int = 1) -> Float32Array:
        """The state (n, state_size) at the beginning of an episode."""
        return np.zeros((n, self.state_size), dtype=np.float32)

    def latent(self, inputs: Float32Array, state: Float32Array) -> tuple[Float32Array, Float32Array]:
        """What goes into the head (n, width), and the next state, for `inputs` (n, inputs) and `state`."""
        values = np.ascontiguousarray(inputs, dtype=np.float32)
        if self.architecture.team is not None:
            values = self._team(values, self.architecture.team)
        if self.architecture.lstm is not None:
            memory, state = self._lstm(values, state, self.architecture.lstm)
            values = np.concatenate([memory, values], axis=1) if self.architecture.lstm.beside else memory
        for number in range(len(self.architecture.hidden)):
            values = self._dense(f"hidden.{number}", values)
            activate(values, self._activation)
        return values, state

    def forward(self, inputs: Float32Array, state: Float32Array) -> tuple[Float32Array, Float32Array]:
        """The head's numbers (n, outputs), before clipping or squashing, and the next state."""
        latent, state = self.latent(inputs, state)
        return self._dense("action", latent), state

    def greedy(self, inputs: Float32Array, state: Float32Array) -> tuple[Any, Float32Array]:
        """The most probable (or best) actions: (n,) int64 for `logits` and `values`, else (n, outputs) in [-1, 1]."""
        outputs, state = self.forward(inputs, state)
        return self._bounded(outputs), state

    def drawn(self, inputs: Float32Array, state: Float32Array, rngs: list[np.random.Generator]) -> tuple[Any, Any]:
        """As `greedy`, but each row's action is drawn from the policy's distribution with its own generator."""
        latent, state = self.latent(inputs, state)
        outputs = self._dense("action", latent)
        if self.architecture.head in ("logits", "values"):
            # Gumbel-max: the greatest of logit + Gumbel noise is a draw from the softmax; Q values have no distribution
            noise = [rng.gumbel(size=outputs.shape[1]) for rng in rngs]
            return np.argmax(outputs + np.array(noise), axis=1) if self.has_distribution else outputs.argmax(1), state
        if self.architecture.head == "gaussian":
            spread = np.broadcast_to(self._arrays["log_std"], outputs.shape)
        else:
            spread = np.clip(self._dense("log_std", latent), *LOG_STD_LIMITS)
        rows = zip(outputs, spread, rngs, strict=True)  # row by row: numpy's exp may differ with the place in an array
        draws = [mean + np.exp(width) * rng.standard_normal(len(mean)) for mean, width, rng in rows]
        return self._bounded(np.array(draws, dtype=np.float32)), state

    @property
    def has_distribution(self) -> bool:
        """Whether the head is a distribution to draw from; Q values are none."""
        return self.architecture.head != "values"

    def _bounded(self, outputs: Float32Array) -> Any:
        if self.architecture.head in ("logits", "values"):
            return np.argmax(outputs, axis=1)
        if self.architecture.head == "gaussian":
            return np.clip(outputs, np.float32(-1.0), np.float32(1.0))
        activate(outputs, TANH)
        return outputs

    def _dense(self, name: str, inputs: Float32Array) -> Float32Array:
        bias, weights = self._arrays.get(f"{name}.bias"), self._arrays[f"{name}.weight"]
        outputs = np.zeros((len(inputs), weights.shape[1]), dtype=np.float32)
        if bias is not None:
            outputs[:] = bias
        dense(inputs, weights, outputs)
        return outputs

    def _team(self, inputs: Float32Array, team: TeamSizes) -> Float32Array:
        """The UAV's own numbers embedded, beside the pooled embeddings of its neighbours: (n, 2 embedding)."""
        n, end = len(inputs), team.start + team.slots * team.slot_size
        slots = inputs[:, team.start : end].reshape(n * team.slots, team.slot_size)
        present: MaskArray = np.ascontiguousarray(slots[:, 0] > 0.5).reshape(n, team.slots)
        own = self._dense("team.own", np.ascontiguousarray(inputs[:, self._own_columns]))
        entries = self._dense("team.entry", np.ascontiguousarray(slots[:, 1:]))
        activate(own, self._activation)
        activate(entries, self._activation)
        pooled = np.empty((n, team.embedding), dtype=np.float32)
        if team.pooling == "attention":
            query, key, value = (
                self._dense(f"team.{name}", values)
                for name, values in (("query", own), ("key", entries), ("value", entries))
            )
            attend(query, key, value, present, pooled)
        else:
            (pool_mean if team.pooling == "mean" else pool_max)(entries, present, pooled)
        return np.concatenate([own, pooled], axis=1)

    def _lstm(self, values: Float32Array, state: Float32Array, lstm: LstmSizes) -> tuple[Float32Array, Float32Array]:
        following = np.empty((len(values), self.state_size), dtype=np.float32)
        for layer in range(lstm.layers):
            at = 2 * layer * lstm.size
            hidden = np.ascontiguousarray(state[:, at : at + lstm.size])
            cell = np.ascontiguousarray(state[:, at + lstm.size : at + 2 * lstm.size])
            gates = self._dense(f"lstm.{layer}.input", values)
            dense(hidden, self._arrays[f"lstm.{layer}.hidden.weight"], gates)
            lstm_cell(gates, hidden, cell)
            following[:, at : at + lstm.size], following[:, at + lstm.size : at + 2 * lstm.size] = hidden, cell
            values = hidden
        return values, following


def _own_columns(architecture: Architecture) -> Any:
    """The columns of the features that are the UAV's own."""
    team = architecture.team
    if team is None:
        return np.arange(architecture.inputs)
    end = team.start + team.slots * team.slot_size
    return np.concatenate([np.arange(team.start), np.arange(end, architecture.inputs)])


def _check(shapes: Mapping[str, tuple[int, ...]], arrays: Mapping[str, Float32Array], where: str) -> None:
    for name, shape in shapes.items():
        if name not in arrays:
            raise InputError(f"{where}: array {name!r} is missing: the architecture needs {', '.join(shapes)}")
        if arrays[name].shape != shape:
            raise InputError(f"{where}: array {name!r}: has the shape {arrays[name].shape}, not {shape}")
    surplus = sorted(set(arrays) - set(shapes))
    if surplus:
        raise InputError(f"{where}: array {surplus[0]!r}: the architecture has none of this name")
