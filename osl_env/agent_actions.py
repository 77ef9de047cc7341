"""What the numbers that learned agents give mean: one translation for training (the views) and deployment (policies).

`hop`: Discrete(26 l_max + 2). direction * l_max + length - 1 hops; 26 l_max hovers and samples again; 26 l_max + 1
declares. `waypoint`: 5 numbers in [-1, 1]. Target x, y, z over the area's sides; samples, from -1 (one) to 1
(`max_samples`); declares if above 0.95. `velocity`: 4 numbers in [-1, 1]. Velocity x, y, z in units of the greatest
speed; declares if above 0.95. `setpoint`: 4 numbers in [-1, 1]. Place to steer to, as an offset x, y, z from the UAV's
own place in units of the vehicle's `lookahead` (the offset at which it flies at its greatest speed); declares if above
0.95.

To declare is to say "the source is here", at the UAV's own place. Under the rule `reach` declaring means nothing.
"""

from __future__ import annotations

import numpy as np

from osl_env.actions import HOP_DIRECTIONS
from osl_env.parameters import FloatArray
from osl_env.state import BoolArray, IntArray

DECLARE_ABOVE = 0.95  # the last number of a continuous action declares beyond this
BOX_SIZES = {"waypoint": 5, "velocity": 4, "setpoint": 4}  # numbers of an action, by its kind


def hover_action(hop_lengths: int) -> int:
    """The hop action that hovers; the next one declares, those below hop."""
    return len(HOP_DIRECTIONS) * hop_lengths


def n_hop_actions(hop_lengths: int) -> int:
    """How many hop actions there are, hovering and declaring included."""
    return hover_action(hop_lengths) + 2


def box_declares(values: FloatArray) -> BoolArray:
    """Which actions (.., 5) or (.., 4) declare: (..) bool."""
    declares: BoolArray = np.greater(values[..., -1], DECLARE_ABOVE)
    return declares


def box_waypoints(values: FloatArray, area: FloatArray, max_samples: int) -> tuple[FloatArray, IntArray]:
    """Targets (.., 3), m, and samples (..) of `waypoint` actions (.., 5), float64."""
    samples = 1 + np.rint((values[..., 3] + 1.0) / 2.0 * (max_samples - 1)).astype(np.int64)
    return (values[..., :3] + 1.0) / 2.0 * area, samples


def box_velocities(values: FloatArray, speed: float) -> FloatArray:
    """Velocities (.., 3), m/s, of `velocity` actions (.., 4), float64."""
    return np.ascontiguousarray(values[..., :3] * speed)


def box_setpoints(values: FloatArray, position: FloatArray, lookahead: float) -> FloatArray:
    """Places to steer to (.., 3), m, of `setpoint` actions (.., 4), float64, of UAVs at `position` (.., 3), m."""
    return np.ascontiguousarray(position + values[..., :3] * lookahead)
