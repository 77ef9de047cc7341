"""MUC-OSL experiment 2: one to eight UAVs, source at [10, 30, 25] m."""

from training.reproduce.claims import Helps, Saturates
from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import PAPER_POLICIES, REMARKS, headline

_SHARING = ("muc-osl", "col-pf", "col-inf")

EXPERIMENT = Experiment(
    name="uavs",
    benchmark="muc_osl_uavs",
    summary="SR and MST of the four algorithms with 1 to 8 UAVs in 100x60x30 m.",
    claims=(
        *headline(),
        Helps("MST falls from 1 to 3 UAVs", PAPER_POLICIES, 1, 3, "capped_search_time"),
        Helps("MST falls from 3 to 8 UAVs", PAPER_POLICIES, 3, 8, "capped_search_time"),
        Helps("SR rises from 1 to 3 UAVs", PAPER_POLICIES, 1, 3, "success_rate"),
        Helps("SR rises from 3 to 8 UAVs", PAPER_POLICIES, 3, 8, "success_rate"),
        Saturates("The gain in MST saturates", _SHARING, 1, 4, 8, "capped_search_time"),
    ),
    remarks=REMARKS
    + " UAVs start at x = 10, 30, 60, 20, 45, 75, 5, 90 m (y = 10, z = 5): the paper gives the first three.",
)
