"""Closes a run into a loop without a visible seam.

The inlet repeats itself with the period L, so the flow nearly does: exactly without obstacles, and as far as the
shedding of vortices follows the inlet with them. The loop begins where two stretches of the run, L apart, are most
alike, and its first seconds are faded from the later stretch into the earlier one:

    u = <u> + (cos(a) u'(t + L) + sin(a) u'(t)) / sqrt(1 + r sin(2 a)),     a = 0 .. pi / 2

r is the correlation of the two stretches, <u> the mean over the loop. A plain cross-fade of stretches that differ
would calm the air in the middle; with this one the variance is kept. Every term is free of divergence and zero in the
walls, and so is the sum.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Frames = NDArray[np.float32]  # (n_t, nx, ny, nz, 3) m/s


class Loop(NamedTuple):
    """A loop, and how well its ends met."""

    frames: Frames
    start: int  # the frame of the run at which it begins
    correlation: float  # r
    jump: float  # largest change between two frames around the seam, relative to the median change elsewhere


def _correlation(a: Frames, b: Frames) -> float:
    return float((a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum()))


def close_loop(run: Frames, length: int, seam: int) -> Loop:
    """A loop of `length` frames of `run`, faded over `seam` frames."""
    last = len(run) - length - seam
    if last < 0:
        raise ValueError(f"the run has {len(run)} frames: {length + seam} are needed")
    overall = run.mean(axis=0)
    ends = [(run[k : k + seam], run[k + length : k + length + seam]) for k in range(last + 1)]
    fit = [_correlation(early - overall, late - overall) for early, late in ends]
    start = int(np.argmax(fit))
    frames = run[start : start + length].copy()
    mean = frames.mean(axis=0)
    early, late = frames[:seam] - mean, run[start + length : start + length + seam] - mean
    r = _correlation(early, late)
    angle = (0.5 * np.pi * (np.arange(seam) + 0.5) / seam).reshape(-1, 1, 1, 1, 1)
    faded = (np.cos(angle) * late + np.sin(angle) * early) / np.sqrt(1.0 + r * np.sin(2.0 * angle))
    frames[:seam] = mean + faded
    changes = np.sqrt(((frames - np.roll(frames, 1, axis=0)) ** 2).mean(axis=(1, 2, 3, 4)))
    return Loop(frames, start, r, float(changes[: seam + 1].max() / np.median(changes[seam + 1 :])))
