"""MUC-OSL experiment 5: experiments 1 to 4 again, in the filament plume with the GADEN values of Table 1."""

from dataclasses import replace

from training.reproduce.experiment import Experiment
from training.reproduce.muc_osl import area, particles, radius, uavs

PREFIX = "gaden-"
_REMARKS = (
    "The paper gives curves and claims, not tables, and does not say how its filters, which count hits, read a "
    "concentration sensor. Here the sensor reports the concentration in units of 20 ppm (the shot noise of the "
    "filaments), the likelihood is Poisson about the plume's steady mean, which the policies are told, and the wind is "
    "steady at 1 m/s, where the paper's comes from a flow solver. A source is found only if it is declared within 5 m, "
    "and a wrong declaration is a failure."
)


def _in_gaden(experiment: Experiment) -> Experiment:
    return replace(
        experiment,
        name=f"{PREFIX}{experiment.name}",
        benchmark=f"muc_osl_gaden_{experiment.name}",
        summary=f"As experiment {experiment.name!r}, in a plume of filaments with a PID sensor. {experiment.summary}",
        remarks=_REMARKS,
    )


EXPERIMENTS = tuple(_in_gaden(module.EXPERIMENT) for module in (area, uavs, radius, particles))
