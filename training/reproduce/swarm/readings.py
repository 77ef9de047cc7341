"""What the paper's experiments have in common here: what it leaves open, and what cannot be compared."""

from __future__ import annotations

REMARKS = (
    "Not the paper's: the places of obstacles, source and robots (it does not state them; the obstacles stand in three "
    "layouts each), the wind (computed in two dimensions at the robots' height, with an unsteady inlet, and begun at "
    "another moment for each run), the plume (filaments in that wind), the sensor's threshold (0.01 g/m^3; emission "
    "matters because the plume is of that order), the time limit. A robot's neighbours are those whose radio it hears, "
    "within delta_d. Of the two delta_d that the paper gives for the small arena, ours is 1 m. The sign of eq 5 is the "
    "text's, not the print's, concentrations are averaged over 5 s, the range sensors see 0.15 m. The paper flew ten "
    "runs a setting and prints its times in figures, which are not at hand as numbers: its claims are compared, its "
    "times are not."
)
