"""Swarm plume tracking and plume finding (Marjovi and Marques)."""
