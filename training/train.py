"""`train`: learn what a configuration says, in a folder from which a stopped training goes on.

The folder holds `config.yaml` (the configuration, complete), `last/` (the whole state of the last save, to resume
from), `best/` (the checkpoint that scored best on the held-out seeds, as it ships), `evaluations.csv` (all scores) and
`tensorboard/`.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from torch.utils.tensorboard import SummaryWriter

from osl_env.configuration import read_yaml
from osl_env.errors import InputError
from training.algorithms import make_model
from training.callbacks import Milestones, diverged, finite, one_interrupt
from training.held_out import Score
from training.records import make_folder, write_text
from training.resume_state import SavedState
from training.run_folder import Diary, RunFolder
from training.training_config import TrainingConfig, make_config

_MAY_CHANGE = ("steps", "threads", "device", "evaluation.jobs")  # when a training is resumed


@dataclass(frozen=True)
class Result:
    """A finished training."""

    name: str
    folder: Path
    steps: int
    seconds: float  # of training and scoring
    best: Score
    last: Score

    @property
    def checkpoint(self) -> Path:
        """The folder of the best checkpoint."""
        return RunFolder(self.folder).best

    def to_dict(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self) | {"folder": str(self.folder), "checkpoint": str(self.checkpoint)}


def train(
    config: TrainingConfig, folder: str | Path, *, resume: bool = False, command: str = "", progress: bool | None = None
) -> Result:
    """Train from the beginning in an empty `folder`, or with `resume` from what was saved last in it, to the end.

    `command` is noted in the checkpoints. `progress`: a bar on stderr; by default if that is a terminal. Raises
    InputError for a folder that does not fit, parts that do not go together, or weights that become infinite;
    TrainingStopped on Ctrl-C.
    """
    place = RunFolder(Path(folder))
    saved = _prepare(config, place, resume)
    env = config.environment.make(config.first_episode_seed)
    try:
        model = make_model(config, env)
        diary = Diary()
        if saved is not None:
            saved.restore(model)
            diary = Diary.of(saved.notes)
        write_text(place.config, yaml.safe_dump(config.dump(), sort_keys=False, width=120))
        show = sys.stderr.isatty() if progress is None else progress
        logger = _tensorboard(place.tensorboard, model.num_timesteps if saved else None)
        model.set_logger(logger)
        try:
            _learn(model, config, place, diary, command, show)
        finally:
            logger.close()
    finally:
        env.close()
    assert diary.best is not None
    return Result(config.name, place.path, model.num_timesteps, diary.seconds, diary.best, diary.scores[-1])


def _learn(
    model: BaseAlgorithm, config: TrainingConfig, place: RunFolder, diary: Diary, command: str, show: bool
) -> None:
    """Learn until all steps are done, then score and save."""
    with one_interrupt() as stop:
        milestones = Milestones(config, place, diary, stop, command, show)
        milestones.init_callback(model)
        try:
            if model.num_timesteps < config.steps:
                model.learn(
                    config.steps - model.num_timesteps,
                    callback=milestones,
                    log_interval=1 if isinstance(model, OnPolicyAlgorithm) else max(4, model.n_envs),
                    reset_num_timesteps=False,
                )
            milestones.finish()
        except ValueError as error:  # torch's distributions refuse weights that are not finite
            if isinstance(error, InputError) or finite(model):
                raise
            raise diverged(model, config, place, diary) from None
        except KeyboardInterrupt as interrupt:
            if str(interrupt):
                raise
            raise milestones.stopped(save=False) from None
        finally:
            milestones.close()


def _prepare(config: TrainingConfig, place: RunFolder, resume: bool) -> SavedState | None:
    """What to resume from, if anything. Raises InputError if the folder holds another training, or none."""
    if not resume:
        if place.state.exists():
            raise InputError(
                f"{place.path}: holds a training already: --resume goes on with it, --folder FOLDER begins elsewhere"
            )
        make_folder(place.path)
        return None
    if not place.state.exists():
        raise InputError(f"{place.path}: holds no training to resume")
    before, now = make_config(read_yaml(place.config), place.config).dump(), config.dump()
    for path, was, wanted in _differences(before, now):
        if path not in _MAY_CHANGE:
            raise InputError(
                f"{place.path}: was trained with {path} = {was!r}, not {wanted!r}; only {', '.join(_MAY_CHANGE)} may"
                " change when a training is resumed"
            )
    return SavedState(place.state)


def _differences(before: Any, now: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """(path, value before, value now) of all that differs."""
    if isinstance(before, dict) and isinstance(now, dict):
        found = []
        for key in [*before, *(key for key in now if key not in before)]:
            found += _differences(before.get(key), now.get(key), f"{path}.{key}" if path else key)
        return found
    return [] if before == now else [(path, before, now)]


class _PurgingTensorBoard(TensorBoardOutputFormat):
    """SB3's, without what an earlier process has written beyond the step from which the training goes on."""

    def __init__(self, folder: Path, from_step: int | None) -> None:
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=from_step)
        self._is_closed = False


def _tensorboard(folder: Path, from_step: int | None) -> Logger:
    return Logger(folder=str(folder), output_formats=[_PurgingTensorBoard(folder, from_step)])
