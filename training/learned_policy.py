"""Policy `sb3`: a user's own Stable-Baselines3 zip (PPO, RecurrentPPO, DQN or SAC), flown like any other policy.

Reading such a zip unpickles parts of it, which can run any code that is in there: load only files that you trust. (A
checkpoint's folder, policy `checkpoint`, is read without.) Where the network is one that `training.networks` can
export, it is flown by the same numpy forward pass as a checkpoint; any other by torch, one UAV at a time, so that its
actions do not depend on the batch either.

What is in the zip does not say which features the observation is made of. Without `features` it is the environments'
own flat vector, and the number of neighbours in it follows from its size: none for `osl_env/Solo-v0`. Nor does it say
what four numbers of an action mean: velocities, unless `agent` says setpoints.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
import warnings
import zipfile
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from baselines import Policy, register_policy
from baselines.features import FeatureSpec, RawFeatures, make_spec, spec_size
from baselines.learned.network import Architecture, Network
from baselines.learned.pilot import ActionDefinition, Brain, Pilot
from baselines.learned.policies import PilotedPolicy
from osl_env.agent_actions import BOX_SIZES, n_hop_actions
from osl_env.errors import InputError

Algorithm = Literal["PPO", "RecurrentPPO", "DQN", "SAC"]
Agent = Literal["hop", "waypoint", "velocity", "setpoint"]
_MODULES = {"PPO": "stable_baselines3", "DQN": "stable_baselines3", "SAC": "stable_baselines3",
            "RecurrentPPO": "sb3_contrib"}  # fmt: skip
# attributes that SB3 saves for one of the algorithms and for none of those below it
_MARKS: tuple[tuple[str, Algorithm], ...] = (
    ("_last_lstm_states", "RecurrentPPO"),
    ("target_entropy", "SAC"),
    ("exploration_fraction", "DQN"),
    ("clip_range", "PPO"),
)
_UNLIMITED = 2**31  # UAVs: the zip does not say


class TorchNetwork:
    """An SB3 model whose network cannot be exported, with the interface of `Network`; one row after the other."""

    def __init__(self, path: Path, algorithm: Algorithm, model: Any, architecture: Architecture) -> None:
        """`path` and `algorithm` say where another process finds the model again."""
        self.architecture = architecture
        self.n_parameters = sum(weights.numel() for weights in model.policy.parameters())
        self._origin, self._model = (path, algorithm), model
        lstm = architecture.lstm
        self._state_shape = (0, 0, 1, 0) if lstm is None else (2, lstm.layers, 1, lstm.size)

    def __deepcopy__(self, memo: dict[int, Any]) -> TorchNetwork:
        return self

    def __reduce__(self) -> Any:
        return _network, self._origin

    @property
    def has_distribution(self) -> bool:
        """Whether there is a distribution to draw from; Q values are none."""
        return self.architecture.head != "values"

    def start(self, n: int = 1) -> NDArray[np.float32]:
        """The state (n, state_size) at the beginning of an episode."""
        return np.zeros((n, int(np.prod(self._state_shape))), dtype=np.float32)

    def greedy(self, inputs: Any, state: Any) -> tuple[Any, Any]:
        """The most probable actions, and the next state."""
        return self._predict(inputs, state, None)

    def drawn(self, inputs: Any, state: Any, rngs: list[np.random.Generator]) -> tuple[Any, Any]:
        """Actions drawn from the model's distribution, each with its row's generator, and the next state."""
        return self._predict(inputs, state, rngs)

    def _predict(self, inputs: Any, state: Any, rngs: list[np.random.Generator] | None) -> tuple[Any, Any]:
        import torch

        actions, following = [], []
        with torch.random.fork_rng(devices=[]):
            for row in range(len(inputs)):
                if rngs is not None:
                    torch.manual_seed(int(rngs[row].integers(2**63)))
                memory = tuple(state[row].reshape(self._state_shape)) if state.size else None
                action, memory = self._model.predict(
                    inputs[row : row + 1], memory, np.zeros(1, np.bool_), deterministic=rngs is None
                )
                actions.append(action[0])
                following.append(np.array(memory, dtype=np.float32).reshape(-1) if state.size else state[row])
        return np.array(actions), np.array(following, dtype=np.float32)


@register_policy
class Sb3Policy(PilotedPolicy):
    """Flies the SB3 zip at `path`. It is unpickled: only files that you trust."""

    name: ClassVar[str] = "sb3"
    summary: ClassVar[str] = "your own SB3 zip (path=); it is unpickled, so only files that you trust"

    path: Path
    algorithm: Algorithm | None = None  # found in the zip, if not given
    features: tuple[dict[str, Any], ...] = ()  # as in training; none: the environments' own vector
    agent: Agent | None = None  # the scenario's action in training; found in the zip, if not given

    def _loaded(self) -> tuple[Policy, str]:
        digest = _digest(self.path)
        algorithm = self.algorithm or _algorithm_of(self.path)
        model = _model(self.path, algorithm, digest)
        where = f"{self.path} ({algorithm})"
        agent, action = _agent(model.action_space, where, self.agent)
        spec = self._spec(model.observation_space, where)
        brain = Brain(where, agent, _network(self.path, algorithm), spec, action, _UNLIMITED)
        return Pilot.of(brain.checked(), self.stochastic), digest

    def _spec(self, space: Any, where: str) -> FeatureSpec:
        """The features that make up an observation of `space`. Raises InputError if none do."""
        size = int(np.prod(space.shape)) if getattr(space, "shape", None) and len(space.shape) == 1 else 0
        if self.features:
            spec = make_spec(list(self.features), "features")
            if spec_size(spec) != size:
                raise InputError(f"{where}: was trained on observations {space}, the features have {spec_size(spec)}")
            return spec
        own = spec_size((RawFeatures(neighbours=0),))
        neighbours, rest = divmod(size - own, spec_size((RawFeatures(neighbours=1),)) - own)
        if rest or not 0 <= neighbours <= 63:
            raise InputError(
                f"{where}: was trained on observations {space}, which are not those of one UAV: give the training's "
                "features"
            )
        return (RawFeatures(neighbours=neighbours),)


def _agent(space: Any, where: str, wanted: Agent | None) -> tuple[Agent, ActionDefinition]:
    """The kind of agent that has the action space `space`: the first, or the `wanted`. Raises InputError if there is
    none.
    """
    fitting: tuple[Agent, ...] = ()
    action = ActionDefinition()
    if hasattr(space, "n"):
        lengths, rest = divmod(int(space.n) - n_hop_actions(0), n_hop_actions(1) - n_hop_actions(0))
        if not rest and lengths >= 1:
            fitting, action = ("hop",), ActionDefinition(hop_lengths=lengths)
    elif hasattr(space, "low") and (space.low == -1.0).all() and (space.high == 1.0).all():
        boxes: tuple[Agent, ...] = ("waypoint", "velocity", "setpoint")
        fitting = tuple(kind for kind in boxes if space.shape == (BOX_SIZES[kind],))
    if not fitting:
        raise InputError(
            f"{where}: was trained with actions {space}: one UAV has Discrete(26 l_max + 2), or a Box from -1 to 1 of"
            " 5 (waypoint) or 4 (velocity, setpoint)"
        )
    if wanted is not None and wanted not in fitting:
        raise InputError(
            f"agent = {wanted!r}: {where} was trained with actions {space}, which are those of {' or '.join(fitting)}"
        )
    return wanted or fitting[0], action


def _digest(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def _algorithm_of(path: Path) -> Algorithm:
    """The algorithm whose marks are in the zip's list of attributes, which is plain JSON. Raises InputError."""
    try:
        with zipfile.ZipFile(path) as archive:
            attributes = json.loads(archive.read("data"))
    except (zipfile.BadZipFile, KeyError, ValueError, RuntimeError):
        raise InputError(f"{path}: is not a zip that Stable-Baselines3 has saved") from None
    for mark, algorithm in _MARKS:
        if mark in attributes:
            return algorithm
    raise InputError(f"{path}: its algorithm cannot be told: must be one of {', '.join(_MODULES)}; give algorithm=")


@functools.lru_cache(maxsize=8)
def _model(path: Path, algorithm: Algorithm, digest: str) -> Any:
    """The SB3 model in the file with `digest`. Warns, and raises InputError if it cannot be loaded."""
    try:
        learner = getattr(importlib.import_module(_MODULES[algorithm]), algorithm)
    except ImportError as error:
        raise InputError(f"needs {error.name}, which is not installed: pip install 'osl-env[train]'") from None
    warnings.warn(
        f"{path}: loading it unpickles it, which can run any code that it holds: only files that you trust",
        stacklevel=2,
    )
    try:
        return learner.load(path, device="cpu")
    except Exception as error:  # unpickling a foreign file may raise anything
        raise InputError(f"{path}: cannot be loaded as {algorithm} ({type(error).__name__}: {error})"[:300]) from None


def _network(path: Path, algorithm: Algorithm) -> Network | TorchNetwork:
    """The exported network, or torch's own where it cannot be exported."""
    from training.networks import exported

    model = _model(path, algorithm, _digest(path))
    try:
        architecture, arrays = exported(model)
    except InputError:
        return TorchNetwork(path, algorithm, model, _outline(model))
    return Network(Architecture.parse(architecture, algorithm), arrays, algorithm)


def _outline(model: Any) -> Architecture:
    """What of a model's architecture concerns a pilot: sizes of input, output and state."""
    space = model.action_space
    discrete = hasattr(space, "n")
    content: dict[str, Any] = {
        "kind": "mlp",
        "inputs": max(int(np.prod(model.observation_space.shape or ())), 1),
        "outputs": int(space.n) if discrete else max(int(np.prod(space.shape or ())), 1),
        "head": "values" if hasattr(model.policy, "q_net") else "logits" if discrete else "gaussian",
    }
    if hasattr(model.policy, "lstm_actor"):
        lstm = model.policy.lstm_actor
        content |= {"kind": "lstm", "lstm": {"size": lstm.hidden_size, "layers": lstm.num_layers}}
    return Architecture.parse(content, type(model).__name__)
