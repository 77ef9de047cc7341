"""What the paper's experiments have in common here: what it leaves open, and what cannot be compared."""

from __future__ import annotations

REMARKS = (
    "Ours and the paper's differ in the world. Its plume comes from a plugin whose dispersion depends on the step, and "
    "whose noise, wind and sensor are not fully stated; ours has the same filaments and release rates, noise that "
    "scales with the square root of the step, and the wind and sensor of the scenario. RMSE and SC hang on that plume "
    "more than on any policy, as the map of zeros shows: a plume that fills few cells leaves little to get wrong. They "
    "mean something beside that map alone, on the same episodes. The paper states no normalisation of RMSE; ours is by "
    "the truth's largest value at the centres of the cells. Of its four cases, rows A and D are at hand. The policy's "
    "parameters are the readings of its page, tuned to no case."
)
