"""MUC-OSL's running example: 100x200x50 m, source in the far upper right corner."""

from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl.readings import REMARKS, headline

EXPERIMENT = Experiment(
    name="example",
    benchmark="muc_osl_example",
    summary="The four algorithms in 100x200x50 m, UAVs from [10, 10, 5], [30, 10, 5] and [60, 10, 5] m.",
    claims=headline(),
    remarks=REMARKS,
    by_policy=True,
    picture_of="muc-osl",
)
