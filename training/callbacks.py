"""What happens around a training: scores and saves when they are due, a bar, checks of the numbers, and a clean stop.

Everything happens between two rollouts, where the state is complete; what is due is told from the number of steps
alone, so a training that was stopped and resumed scores and saves where an uninterrupted one does.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from osl_env.errors import InputError
from training.held_out import Score, make_checkpoint, score, with_score, write_scores
from training.resume_state import save_state, untouched_generators
from training.run_folder import Diary, RunFolder
from training.training_config import TrainingConfig

_CHECK_EVERY = 2_000  # steps between two looks at the weights, where rollouts are shorter


class TrainingStopped(KeyboardInterrupt):
    """Ctrl-C during a training; the message says what is kept and how to go on."""


class StopRequest:
    """Whether somebody pressed Ctrl-C."""

    asked = False


@contextmanager
def one_interrupt() -> Iterator[StopRequest]:
    """The first Ctrl-C asks for a stop at the end of the rollout; the second stops at once."""
    request = StopRequest()
    if threading.current_thread() is not threading.main_thread():  # where Python delivers no signals
        yield request
        return
    before = signal.getsignal(signal.SIGINT)

    def ask(number: int, frame: object) -> None:
        if request.asked:
            raise KeyboardInterrupt
        request.asked = True
        print("\nosl: stopping at the end of this rollout; Ctrl-C again stops at once", file=sys.stderr)

    signal.signal(signal.SIGINT, ask)
    try:
        yield request
    finally:
        signal.signal(signal.SIGINT, before)


class Milestones(BaseCallback):
    """Scores, saves, checks and stops between rollouts."""

    def __init__(
        self, config: TrainingConfig, folder: RunFolder, diary: Diary, stop: StopRequest, command: str, show: bool
    ) -> None:
        """`show`: a bar on stderr."""
        super().__init__()
        self.config, self.folder, self.diary, self.stop, self._command = config, folder, diary, stop, command
        self._show = show
        self._bar: Any = None
        self._clock = time.monotonic()
        self._checked_at = 0

    def _on_training_start(self) -> None:
        self._clock = time.monotonic()
        self._bar = tqdm(
            total=self.config.steps, initial=self.num_timesteps, unit="step", unit_scale=True, disable=not self._show
        )

    def _on_step(self) -> bool:
        """Check what the environment gave: a NaN spreads to all weights with the next update."""
        for name in ("rewards", "new_obs"):
            if not np.isfinite(np.sum(self.locals[name])):
                raise FloatingPointError(f"step {self.num_timesteps}: {name} of the environment are not finite")
        self._bar.update(self.model.n_envs)
        return True

    def _on_rollout_start(self) -> None:
        self.between_rollouts()
        self._tell_progress()

    def between_rollouts(self) -> None:
        """Do what is due. Raises TrainingStopped if somebody asked for it, InputError if weights are not finite."""
        steps, diary = self.model.num_timesteps, self.diary
        score_now = _crossed(self.config.evaluation.every, diary.scored_at, steps)
        save_now = diary.saved_at is None or _crossed(self.config.checkpoints.every, diary.saved_at, steps)
        if score_now or save_now or self.stop.asked or steps >= self._checked_at + _CHECK_EVERY:
            self._check_weights()
        if score_now and not self.stop.asked:
            self._score_or_stop()
        if self.stop.asked:
            raise self.stopped(save=True)
        if save_now:
            diary.saved_at = steps
            self.save()

    def _tell_progress(self) -> None:
        """An environment with a method `redraw` may draw new scenarios that suit the progress."""
        redraw = getattr(self.model.env, "redraw", None)
        if redraw is not None:
            redraw(min(1.0, self.model.num_timesteps / self.config.steps))

    def finish(self) -> None:
        """Score and save what the training ends with."""
        self._check_weights()
        if self.diary.scored_at != self.model.num_timesteps and not self.stop.asked:
            self._score_or_stop()
        if self.stop.asked:
            raise self.stopped(save=True)
        self.save()

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()

    def _score_or_stop(self) -> None:
        try:
            self.score()
        except KeyboardInterrupt:  # the score is not noted, so a resumed training begins with it
            self.stop.asked = True

    def score(self) -> Score:
        """Score the network as it is, and keep it if it is the best so far."""
        diary, model = self.diary, self.model
        self._tick()
        with untouched_generators(model):
            checkpoint = make_checkpoint(model, self.config, command=self._command, seconds=diary.seconds)
            found = score(checkpoint, self.config, self.folder.path)
        if found.beats(diary.best):
            with_score(checkpoint, found, self.config).write(self.folder.best)
            diary.best = found
        diary.scores.append(found)
        diary.scored_at = found.steps
        write_scores(self.folder.scores, diary.scores)
        for name in ("success_rate", "capped_search_time", "reward"):
            model.logger.record(f"held_out/{name}", getattr(found, name))
        model.logger.dump(model.num_timesteps)
        if self._bar is not None:
            minutes = found.capped_search_time / 60
            self._bar.set_postfix_str(f"held out {100 * found.success_rate:.0f} %, {minutes:.2f} min")
        return found

    def save(self) -> None:
        """Save the whole state."""
        self._tick()
        save_state(self.folder.state, self.model, self.diary.notes())

    def stopped(self, *, save: bool) -> TrainingStopped:
        """The exception that says what is kept, after saving if that is asked for."""
        if save:
            self.save()
            kept = f"all of them kept in {self.folder.path}"
        else:
            kept = f"those up to {self.diary.saved_at or 0:,} kept in {self.folder.path}"
        done = f"{self.model.num_timesteps:,} of {self.config.steps:,} steps"
        return TrainingStopped(f"stopped after {done}, {kept}; the same command with --resume goes on from there")

    def _tick(self) -> None:
        now = time.monotonic()
        self.diary.seconds += now - self._clock
        self._clock = now

    def _check_weights(self) -> None:
        self._checked_at = self.model.num_timesteps
        if not finite(self.model):
            raise diverged(self.model, self.config, self.folder, self.diary)


def _crossed(every: int, before: int, now: int) -> bool:
    """Whether a multiple of `every` lies in (before, now]."""
    return now // every > before // every


def finite(model: BaseAlgorithm) -> bool:
    """Whether all weights are."""
    with torch.no_grad():
        return all(bool(torch.isfinite(weights).all()) for weights in model.policy.parameters())


def diverged(model: BaseAlgorithm, config: TrainingConfig, folder: RunFolder, diary: Diary) -> InputError:
    """The error that says so."""
    return InputError(
        f"{config.name}: the weights are not finite any more after {model.num_timesteps:,} steps: try a smaller"
        f" algorithm.learning_rate (now {config.algorithm.learning_rate:g}); the state of step {diary.saved_at or 0:,}"
        f" is kept in {folder.path}"
    )
