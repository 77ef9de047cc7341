"""MUC-OSL experiment 1: four areas, three UAVs."""

from training.reproduce.claims import Beats, Helps
from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import PAPER_POLICIES, REMARKS, headline

EXPERIMENT = Experiment(
    name="area",
    benchmark="muc_osl_area",
    summary="SR and MST of the four algorithms in areas of 60x60x30 to 100x200x50 m with 3 UAVs.",
    claims=(
        *headline(),
        Beats("Col-PF has a higher SR than Col-Inf", "col-pf", "col-inf", "success_rate"),
        Beats("Col-PF has a shorter MST than Col-Inf", "col-pf", "col-inf", "capped_search_time"),
        Beats("Col-PF has a shorter MST than Adap-PP", "col-pf", "adap-pp", "capped_search_time"),
        Helps(
            "Larger areas cost time: 60x60x30 is faster than 100x200x50",
            PAPER_POLICIES,
            "100x200x50",
            "60x60x30",
            "capped_search_time",
        ),
        Helps(
            "Larger areas cost success: 60x60x30 against 100x200x50",
            PAPER_POLICIES,
            "100x200x50",
            "60x60x30",
            "success_rate",
        ),
        Beats("Adaptive steps hover less than fixed ones (MUC-OSL, Col-PF)", "muc-osl", "col-pf", "n_hovers"),
        Beats("(ours) Roughening alone lifts Col-Inf's SR", "col-inf-roughened", "col-inf", "success_rate"),
        Beats("(ours) Roughening alone lifts Adap-PP's SR", "adap-pp-roughened", "adap-pp", "success_rate"),
    ),
    remarks=REMARKS
    + " The rows marked (ours) show how much of the gap is the particle impoverishment of the traditional filter, "
    "which roughening cures without any of the paper's collaboration.",
)
