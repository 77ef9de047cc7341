"""How a table came about: command, versions, machine class, duration. No host, user or folder names."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import osl_env
from training.store import digest_of_sources
from training.sweep import check_jobs

_PACKAGES = ("numpy", "numba", "scipy", "gymnasium", "pettingzoo", "torch", "stable-baselines3")


@dataclass(frozen=True)
class Provenance:
    """One run of a command that flies episodes."""

    command: str  # as one would type it
    date: str  # UTC
    seconds: float  # of wall time
    processes: int
    episodes: int  # in the table; what two rows share counts once
    from_store: int  # of them, flown before

    def lines(self) -> dict[str, str]:
        """What a reader is told, by heading."""
        flown = self.episodes - self.from_store
        return {
            "command": self.command,
            "date": self.date,
            "episodes": f"{self.episodes:,}, of which {flown:,} were flown now and {self.from_store:,} before",
            "duration": f"{_duration(self.seconds)} with {self.processes} process{'es' * (self.processes > 1)}",
            "machine": machine_class(),
            "versions": ", ".join(f"{name} {number}" for name, number in versions().items()),
            "sources": f"SHA-256 {digest_of_sources()[:12]} (osl_env and baselines)",
        }


def machine_class() -> str:
    """Kind of machine, cores and memory: `Linux x86_64, 2 cores, 8 GB`."""
    text = f"{platform.system()} {platform.machine()}, {check_jobs(None)} cores"
    if "SC_PHYS_PAGES" in getattr(os, "sysconf_names", ()):
        text += f", {os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 1e9:.0f} GB"
    return text


def versions() -> dict[str, str]:
    """Ours, Python's, and those of the installed packages that figures may depend on."""
    found = {"osl-env": osl_env.__version__, "Python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # torch and its like are optional
            continue
    return found


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
