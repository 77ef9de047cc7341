"""What each of our readings of GaSLAM is worth: another in its place, everything else as it is."""

from training.reproduce.gaslam.claims import Worsens
from training.reproduce.gaslam.experiment import GasExperiment

EXPERIMENT = GasExperiment(
    name="ablation",
    title="GaSLAM, ablations of our readings",
    summary="Cases A to D with one reading at a time replaced, on the same seeds.",
    benchmark="gaslam_ablation",
    claims=(
        Worsens("all cells", "Unexplored cells, read as zeros, place the source worse"),
        Worsens("entropy weights", "Weighting guesses by their entropy, as printed, places the source worse"),
        Worsens("equal weights", "Equal weights of the guesses place the source worse"),
        Worsens("printed vectors", "Vectors of any length in V_goal, as printed, place the source worse"),
        Worsens("printed V_diff", "Flying to the largest difference again and again, as printed, places it worse"),
    ),
    compares_settings=True,
)
