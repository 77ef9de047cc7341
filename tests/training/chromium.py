"""Headless Chromium for tests of pages: what the page is after its script ran, without a network."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = (
    "--headless",
    "--no-sandbox",  # a container's root has none
    "--disable-gpu",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--hide-scrollbars",
    "--host-resolver-rules=MAP * ~NOTFOUND",  # no name is ever looked up
    "--enable-logging=stderr",
    "--virtual-time-budget=2000",
)


class Chromium:
    """The browser; each call is a process of its own, with a profile that is empty."""

    def __init__(self, folder: Path) -> None:
        found = next((path for name in _NAMES if (path := shutil.which(name))), None)
        if found is None:
            pytest.skip("no Chromium on this machine: apt-get install chromium")
        self._program = found
        self._folder = folder
        self._calls = 0

    def page(self, address: str, width: int = 1200) -> tuple[str, str]:
        """The document at `address` as HTML after its script ran, and what the browser's console said."""
        done = self._call("--dump-dom", f"--window-size={width},900", address)
        console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
        return done.stdout, "\n".join(console)

    def screenshot(self, address: str, path: Path, width: int = 1200) -> bytes:
        """A PNG of the page, which is also written to `path`."""
        self._call(f"--screenshot={path}", f"--window-size={width},900", address)
        return path.read_bytes()

    def _call(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        self._calls += 1
        profile = f"--user-data-dir={self._folder / f'profile{self._calls}'}"
        command = [self._program, *_FLAGS, profile, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
        return done
