"""What the agent's kernels read and write: layouts of the state, batched over crews (worlds, or one UAV's own view)."""

from __future__ import annotations

import numpy as np

_VECTOR = (np.float64, 3)

MATE = np.dtype(  # (n_crews, n_uavs)
    [
        ("position", *_VECTOR),  # m
        ("heading", *_VECTOR),  # unit vector of the last flight; zero before the first
        ("goal", *_VECTOR),  # m: where it means to sample
        ("place", *_VECTOR),  # m: where the leg that it has chosen in this beat ends
        ("seconds", np.float64),  # of sampling there
        ("planned", np.bool_),  # whether it has chosen in this beat
        (
            "hold",
            np.float64,
        ),  # s, mission clock: until then it keeps its goal while the team searches for a first trace
        ("known", np.bool_),  # whether it is in radio contact (itself included)
    ],
    align=True,
)
SITUATION = np.dtype(  # (n_crews,)
    [
        ("wind", *_VECTOR),  # m/s, mean of what was measured
        ("mean", *_VECTOR),  # m, of the belief
        ("covariance", np.float64, (3, 3)),  # m^2
        ("entropy", np.float64),  # nats, over cells
        ("certainty", np.float64),  # mass within the success radius of the mean
        ("clock", np.float64),  # s, of the mission
        ("last_detection", np.float64),  # s; 0 before the first
        ("last_hits", np.float64),  # of the team, in the last beat
        ("heard", np.bool_),  # whether anything has been detected
        ("searching", np.bool_),  # no trace, or lost it
        ("decision", np.int64),
    ],
    align=True,
)
SETTING = np.dtype(  # (1,)
    [
        ("area", *_VECTOR),  # m
        ("speed", np.float64),  # m/s
        ("turn_time", np.float64),  # s
        ("sample", np.float64),  # s
        ("leg_time", np.float64),  # s
        ("horizon", np.float64),  # s: what places are compared for while searching
        ("dwell", np.float64),  # s of sampling that goals are compared for on a trace
        ("entropy_weight", np.float64),  # m of distance that a nat is worth, in the reference
        ("stand", np.float64),  # s: how long a place is kept while searching
        ("most_samples", np.int64),  # of a leg
        ("strength", np.float64),  # a Q, m/s, as advertised
    ],
    align=True,
)
