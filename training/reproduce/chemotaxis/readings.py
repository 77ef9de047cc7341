"""What all of the paper's experiments have in common here: what it leaves open, and how we read it."""

from __future__ import annotations

REMARKS = (
    "Each of the paper's times is one flight. Its search follows differences of nearby readings and is chaotic: a "
    "seeded jitter of 1e-9 m on the buffered positions can move the time of one and the same cell by many seconds. "
    "Our spread is that of this jitter alone: another reading of the open text moves cells by as much again, also "
    "those with little spread, so that an interval without the paper's time says little. No parameter is tuned to any"
    " cell; what can be compared is success, the order of the means, and the detections of straight sweeps, which "
    "hardly depend on the seed. Read from open text: a way point is a carrot 2.5 m ahead in the scan and 1 m in the "
    "search; a plume of puffs, developed at the start, with Briggs A dispersion over each puff's own path; least "
    "squares on positions with that jitter, as on a straight sweep the printed one has no unique solution; targets "
    "stay inside the bounds, and leaving them by more than 0.5 m ends a flight. The vehicle is our own rigid body and"
    " geometric controller with the crazyflie's parameters, held against RotorPy's by a test. Unlike that one, it "
    "limits the tilt, to 60 degrees: without a limit a way point more than 0.65 m below turns the vehicle over, and "
    "some 3 % of the flights are lost. Success means reached, knowing it or not, as in the paper."
)
