"""Throws away compiled kernels that no longer fit the sources.

Numba keeps compiled kernels beside each module and compiles anew when that module's file changes, but it does not see
that a function which was inlined from another file, or the layout of an array, has changed: after an update of a
source tree it would run stale code on new data. So the kernels are dropped whenever any source file of the packages has
changed since they were compiled.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

_PACKAGES = ("osl_env", "baselines")  # those with kernels
_STAMP = "kernels.stamp"


def drop_stale_kernels(folder: Path | None = None) -> bool:
    """Delete the kernels beside the packages in `folder` if a source has changed since; True if so.

    Where nothing can be written, numba keeps its kernels elsewhere, by installation, and there is nothing to do.
    """
    root = folder or Path(__file__).resolve().parent.parent
    sources = sorted(path for package in _PACKAGES for path in (root / package).rglob("*.py"))
    facts = [(str(path.relative_to(root)), path.stat().st_mtime_ns, path.stat().st_size) for path in sources]
    digest = hashlib.sha256(repr(facts).encode()).hexdigest()
    stamp = root / _PACKAGES[0] / "__pycache__" / _STAMP
    with contextlib.suppress(OSError):
        if stamp.is_file() and stamp.read_text() == digest:
            return False
        stale = [path for package in _PACKAGES for path in (root / package).rglob("__pycache__/*.nb[ic]")]
        for path in stale:
            path.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        fresh = stamp.with_suffix(f".{os.getpid()}")
        fresh.write_text(digest)
        fresh.replace(stamp)
        return bool(stale)
    return False
