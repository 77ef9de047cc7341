"""Chemotaxis: scan the volume by lawn-mower, then climb the concentration gradient (see `policy`)."""
