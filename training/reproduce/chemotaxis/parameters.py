"""The paper's parameter study on Source 1: a faster wind, a higher threshold, a shorter and a longer buffer."""

from training.reproduce.chemotaxis.cells import Part
from training.reproduce.chemotaxis.claims import FlightsSucceed
from training.reproduce.chemotaxis.experiment import CellExperiment
from training.reproduce.chemotaxis.readings import REMARKS
from training.reproduce.chemotaxis.tables_of_paper import PARTS

EXPERIMENT = CellExperiment(
    name="parameters",
    title="Chemotaxis, parameter study on Source 1",
    summary="Table 1 again with a wind of 3.0 m/s, a threshold of 0.08, and buffers of 10 and 40, each alone.",
    parts=(
        PARTS[1],
        Part("chemotaxis_wind", 1, base=False),
        Part("chemotaxis_threshold", 1, base=False),
        Part("chemotaxis_window", 1, base=False),
    ),
    claims=(FlightsSucceed(0.95),),
    remarks=REMARKS
    + " Base: u = 2 m/s, c_thresh = 0.05, N = 20. The settings are compared with our own base, start by start; the "
    "paper's figures of this study are not set beside ours.",
    compares_settings=True,
)
