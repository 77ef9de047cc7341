"""The layout of a world's state: one structured array for each concern, batched over (n_envs, n_uavs).

Parameters and state never mix: models are frozen, and everything that changes lives in these arrays, which `World`
owns. Grouped by concern, so that a kernel touches only what it needs. Units are SI; shapes are those of one UAV.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

StateArray: TypeAlias = NDArray[Any]  # a structured array of one of the layouts below
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]

DETECTION_MEMORY = 3  # K: how many detections a UAV remembers, latest first
ENERGY_KINDS = ("flying", "hovering", "turning", "waiting", "computing", "communicating")
FLYING, HOVERING, TURNING, WAITING, COMPUTING, COMMUNICATING = range(len(ENERGY_KINDS))
RUNNING, SUCCESS, FALSE_DECLARATION, ENDED = range(4)  # outcomes of an episode
STOP, SLIDE, END = range(3)  # what a collision with an obstacle does
# fates of a UAV: it flies, has left the bounds, its flight has become unstable, a fault has ended it
FLYING_ON, LEFT, DIVERGED, LOST = range(4)

_F, _I, _C, _S, _B, _U = np.float64, np.int64, np.int32, np.int8, np.bool_, np.uint64

MOTION = np.dtype(  # (n_envs, n_uavs)
    [
        ("position", _F, (3,)),  # m
        ("heading", _F, (3,)),  # unit vector of the last flight; zero before the first
        ("target", _F, (3,)),  # m, end of the present leg
        ("origin", _F, (3,)),  # m, where the present leg or period began
        ("leg_turn", _F),  # s, parts of the present leg's duration
        ("leg_flight", _F),
        ("leg_hover", _F),
        ("leg_path", _F),  # m
        ("leg_flying_energy", _F),  # J, of the present leg's flight and hover
        ("leg_hovering_energy", _F),
        ("leg_end", _F),  # s, mission clock at which the leg is done
        ("samples", _C),  # completed sampling times of the leg
        ("turns", _C),  # 1 if the leg begins with a turn
        ("active", _B),  # still flying in this episode
        ("ready", _B),  # its leg is done: it decides now
        ("exhausted", _B),  # its battery ends during this leg
        ("terminated", _B),
        ("truncated", _B),
        ("collided", _B),  # the last leg or period ran into an obstacle
        ("fate", _S),  # FLYING_ON, LEFT, DIVERGED, LOST
        ("silent", _B),  # its radio is lost: it neither sends nor hears
        ("velocity", _F, (3,)),  # m/s; zero between legs
    ],
    align=True,
)

LEDGER = np.dtype(  # (n_envs, n_uavs)
    [
        ("energy", _F, (len(ENERGY_KINDS),)),  # J spent, by kind
        ("spent", _F),  # J, their sum, kept beside them
        ("search_time", _F),  # s, flying + hovering + turning time, kept beside them: waiting is not counted
        ("turning_time", _F),  # s
        ("flying_time", _F),
        ("hovering_time", _F),
        ("waiting_time", _F),
        ("path", _F),  # m
        ("bytes", _I),  # sent
        ("messages", _C),  # radio frames sent
        ("turns", _C),
        ("hovers", _C),  # hovering points (n_h of MUC-OSL eq 5)
        ("flights", _C),
        ("decisions", _C),
        ("collisions", _C),  # legs or periods that ran into an obstacle
        ("rewarded_energy", _F),  # J, energy and search time up to which rewards have been paid
        ("rewarded_time", _F),
        ("potential", _F),  # of the shaping term
        ("total_reward", _F),
    ],
    align=True,
)

SENSES = np.dtype(  # (n_envs, n_uavs)
    [
        ("wind", _F, (3,)),  # m/s, as measured
        ("reading", _F),  # hits or concentration of the last sample
        ("sampling_time", _F),  # s; 0: nothing sampled yet
        ("gas_stream", _U),
        ("sent_time", _F),  # s, mission clock at which the last frame was sent
        ("detections", _C),  # so far
        ("fresh", _B),  # the last sample was a detection and is of this step
        ("dead", _B),  # the gas sensor reads 0 from now on
        ("first_detection_time", _F),  # s, mission clock; NaN: none
        ("detection_time", _F, (DETECTION_MEMORY,)),
        ("detection_position", _F, (DETECTION_MEMORY, 3)),
        ("detection_reading", _F, (DETECTION_MEMORY,)),
        ("anemometer_stream", _U),
        ("radio_stream", _U),
    ],
    align=True,
)

FRAME = np.dtype(  # heard: (n_envs, receiver, sender); sent: (n_envs, sender, queue); unused if all hear all at once
    [
        ("position", _F, (3,)),  # m, of the sender when it sent
        ("reading", _F),
        ("sampling_time", _F),  # s
        ("time", _F),  # s, mission clock when sent
        ("known", _B),
    ],
    align=True,
)

EPISODE = np.dtype(  # (n_envs,)
    [
        ("clock", _F),  # s, mission clock
        ("seed", _I),
        ("outcome", _I),  # RUNNING, SUCCESS, FALSE_DECLARATION, ENDED
        ("winner", _I),  # the UAV that declared or reached; -1
        ("search_time", _F),  # s, the winner's own flying + hovering + turning time
        ("declared", _F, (3,)),  # m; NaN: none
        ("declaration_error", _F),  # m, to the nearest source; NaN: none
        ("wind", _F, (3,)),  # m/s
    ],
    align=True,
)

TEAM = np.dtype(  # (n_envs,): an episode as central control sees it
    [
        ("reward", _F),  # mean of the UAVs' rewards of the last step
        ("terminated", _B),
        ("truncated", _B),  # over, without a declaration or arrival, and some UAV's time or decisions were used up
    ],
    align=True,
)

CONSTANTS = np.dtype(  # (1,): every number that the kernels need of the scenario
    [
        ("area", _F, (3,)),
        ("step_length", _F),
        ("hop_lengths", _I),
        ("speed", _F),
        ("acceleration", _F),
        ("hover_time", _F),
        ("turn_time", _F),
        ("max_samples", _I),
        ("decision_period", _F),
        ("physics_step", _F),
        ("position_gain", _F),
        ("planar", _B),  # vehicles stay at their height
        ("flying_power", _F),
        ("hovering_power", _F),
        ("turn_energy", _F),
        ("capacity", _F),
        ("joule_per_bit_computed", _F),
        ("joule_per_byte_sent", _F),
        ("event_clock", _B),
        ("collision", _I),  # of a UAV with an obstacle: STOP, SLIDE, END
        ("bounds_end", _B),  # leaving the bounds by more than `margin` ends the flight
        ("margin", _F),
        ("reach", _B),
        ("time_limit", _F),
        ("max_decisions", _I),
        ("success_radius", _F),
        ("false_positive_rate", _F),
        ("miss_probability", _F),
        ("dead_time", _F),
        ("wind_noise", _F),
        ("radius", _F),
        ("latency", _F),
        ("loss", _F),
        ("header_bytes", _I),
        ("reward_time", _F),
        ("reward_success", _F),
        ("reward_false_declaration", _F),
        ("reward_energy", _F),
        ("reward_detection", _F),
        ("reward_shaping", _F),
        ("discount", _F),
    ],
    align=True,
)
