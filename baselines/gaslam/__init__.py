"""GaSLAM: simultaneous gas source localization and gas distribution mapping in 3D."""
