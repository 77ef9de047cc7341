"""MUC-OSL experiment 6: energy of MUC-OSL and Col-Inf by kind."""

from training.reproduce.claims import Beats
from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import REMARKS

EXPERIMENT = Experiment(
    name="energy",
    benchmark="muc_osl_energy",
    summary="Energy of MUC-OSL and Col-Inf, split into hovering, turning and flown distance, in the four areas.",
    claims=(
        Beats("MUC-OSL spends less energy than Col-Inf", "muc-osl", "col-inf", "energy"),
        Beats("MUC-OSL has fewer hovering points", "muc-osl", "col-inf", "n_hovers"),
        Beats("MUC-OSL turns less", "muc-osl", "col-inf", "n_turns"),
        Beats("MUC-OSL flies less far", "muc-osl", "col-inf", "team_path"),
        Beats("(ours) MUC-OSL spends less than a roughened Col-Inf", "muc-osl", "col-inf-roughened", "energy"),
    ),
    remarks=REMARKS
    + " Energy is the team's over the whole run, failures included, so that it grows with the search time; waiting "
    "for the slowest UAV is hovering too and is shown apart. What the paper states does not settle the saving's sign.",
    by_policy=True,
    energy_figure=True,
)
