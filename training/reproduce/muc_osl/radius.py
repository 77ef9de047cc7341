"""MUC-OSL experiment 3: communication radius, four UAVs."""

import math

from training.reproduce.claims import Helps, Saturates
from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import REMARKS, headline

_SHARING = ("muc-osl", "col-pf", "col-inf", "adap-pp")

EXPERIMENT = Experiment(
    name="radius",
    benchmark="muc_osl_radius",
    summary="SR and MST of the four algorithms with 4 UAVs in 100x60x30 m, from no radio to all-to-all.",
    claims=(
        *headline(),
        Helps("All-to-all has a shorter MST than no radio", _SHARING, 0, math.inf, "capped_search_time"),
        Helps("All-to-all has a higher SR than no radio", _SHARING, 0, math.inf, "success_rate"),
        Saturates("The gain in MST saturates at 20 to 40 m", _SHARING, 0, 20, 40, "capped_search_time"),
    ),
    remarks=REMARKS
    + " The UAVs start 10 to 50 m apart, so that the smallest radii mean no contact for most of the time.",
)
