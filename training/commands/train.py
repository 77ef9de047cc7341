"""`osl train`: learn a policy from a configuration."""

from __future__ import annotations

import importlib.util
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from osl_env.errors import InputError
from training.commands.options import OptionalCount, OptionalFolder, check_count, print_json

if TYPE_CHECKING:
    from training.train import Result

_NEEDED = ("torch", "stable_baselines3", "sb3_contrib", "safetensors", "tensorboard")


@dataclass(frozen=True)
class Train:
    """Train a policy; score it on held-out seeds and keep the best checkpoint."""

    config: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="CONFIG")]
    """a name from configs/training, or a YAML file"""
    steps: OptionalCount = None
    """decisions of UAVs in all; by default as configured"""
    seed: OptionalCount = None
    """of weights, draws and episodes; by default as configured"""
    folder: OptionalFolder = None
    """for everything; results/training/NAME by default"""
    resume: bool = False
    """go on from the last save in the folder"""
    device: Annotated[Literal["auto", "cpu", "cuda"] | None, tyro.conf.arg(help_behavior_hint="")] = None
    """of the network; by default as configured (cpu)"""
    threads: OptionalCount = None
    """of torch; by default as configured (1)"""
    json: bool = False
    """print JSON only"""

    def execute(self) -> None:
        """Train and print the score. Raises InputError for any bad argument, or without the extra `train`."""
        check_count("steps", self.steps)
        check_count("seed", self.seed, 0)
        check_count("threads", self.threads)
        missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
        if missing:
            raise InputError(f'osl train needs {", ".join(missing)}: pip install "osl-env[train]"')
        from training.train import train
        from training.training_config import load_training

        config = load_training(self.config, **self._changes())
        folder = self.folder or Path("results") / "training" / config.name
        progress = False if self.json else None
        result = train(config, folder, resume=self.resume, command=self._as_typed(), progress=progress)
        self._report(result)

    def _changes(self) -> dict[str, Any]:
        given = {"steps": self.steps, "seed": self.seed, "device": self.device, "threads": self.threads}
        return {name: value for name, value in given.items() if value is not None}

    def _as_typed(self) -> str:
        """The command, without what is only this machine's: where its files lie."""
        config = Path(self.config).name if Path(self.config).is_absolute() else self.config
        options = [f"--{name} {value}" for name, value in self._changes().items()]
        return " ".join(["osl train", shlex.quote(config), *options])

    def _report(self, result: Result) -> None:
        if self.json:
            print_json(result.to_dict())
            return
        print(f"{result.name}: {result.steps:,} steps in {result.seconds / 60:.1f} min")
        print(f"last: {result.last.line()}")
        print(f"best: {result.best.line()}")
        print(f"checkpoint: {result.checkpoint}")
        print(f"fly it: osl run checkpoint SCENARIO --policy-set path={shlex.quote(str(result.checkpoint))}")
