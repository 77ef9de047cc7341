"""The experiments of the MUC-OSL paper (multi-UAV collaboration based odour source localization)."""

from training.reproduce.muc_osl import area, energy, example, gaden, particles, radius, uavs

EXPERIMENTS = {module.EXPERIMENT.name: module.EXPERIMENT for module in (area, uavs, radius, particles, energy, example)}
EXPERIMENTS |= {experiment.name: experiment for experiment in gaden.EXPERIMENTS}
GROUPS = {"gaden": tuple(experiment.name for experiment in gaden.EXPERIMENTS)}  # name -> the experiments that it means
