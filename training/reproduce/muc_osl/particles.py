"""MUC-OSL experiment 4: number of particles, three UAVs."""

from training.reproduce.claims import Helps, Saturates
from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import PAPER_POLICIES, REMARKS, headline

EXPERIMENT = Experiment(
    name="particles",
    benchmark="muc_osl_particles",
    summary="SR and MST of the four algorithms with 20 to 220 particles in 100x60x30 m with 3 UAVs.",
    claims=(
        *headline(),
        Helps("More particles shorten the MST: 20 to 180", PAPER_POLICIES, 20, 180, "capped_search_time"),
        Helps("More particles raise the SR: 20 to 180", PAPER_POLICIES, 20, 180, "success_rate"),
        Saturates("The gain in MST saturates", PAPER_POLICIES, 20, 100, 180, "capped_search_time"),
    ),
    remarks=REMARKS,
)
