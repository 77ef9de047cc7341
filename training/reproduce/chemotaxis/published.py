"""What the paper "3-Dimensional Gas Source Localization via Chemotaxis using Uncrewed Aircraft Systems" prints.

Flight times from the start to 2 m from the source, s, for three sources and five starts (its three tables), one flight
each. Its coordinates are ours moved by `PAPER_ORIGIN`: bounds x -10 .. 20, y -15 .. 15, z 1 .. 11 m.
"""

from __future__ import annotations

FLIGHT_TIMES: dict[int, tuple[float, ...]] = {  # source -> Initial 1 to 5
    1: (13.10, 91.95, 33.25, 22.70, 82.70),
    2: (19.65, 23.45, 14.75, 17.30, 19.50),
    3: (88.50, 19.35, 15.85, 24.35, 18.15),
}
N_STARTS = 5
PAPER_ORIGIN = (-10.0, -15.0, 1.0)  # m: the paper's coordinates of our corner (0, 0, 0)

# the flight that the text describes: nothing in the starting layer, then up one layer, where the plume is met
CLIMB_CELL = (3, 1)  # source, start
CLIMB_START_HEIGHT = 4.0  # m, paper's coordinates
CLIMB_DETECTION_HEIGHT = 6.33  # m
CLIMB_DETECTION_TIME = 77.25  # s


def flight_time(source: int, start: int) -> float:
    """s, of Initial `start` (1 to 5) to Source `source` (1 to 3)."""
    return FLIGHT_TIMES[source][start - 1]
