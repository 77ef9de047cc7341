"""Compiled kernels are dropped when, and only when, a source file has changed."""

from __future__ import annotations

from pathlib import Path

import pytest

from osl_env.kernel_cache import drop_stale_kernels


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for package in ("osl_env", "baselines"):
        (tmp_path / package / "__pycache__").mkdir(parents=True)
        (tmp_path / package / "kernels.py").write_text("x = 1\n")
    return tmp_path


def compiled(tree: Path) -> list[Path]:
    kernels = [tree / package / "__pycache__" / f"kernels.f-1.py311{end}" for package, end in
               (("osl_env", ".nbi"), ("osl_env", ".1.nbc"), ("baselines", ".nbi"))]  # fmt: skip
    for kernel in kernels:
        kernel.write_bytes(b"machine code")
    return kernels


def test_unchanged_sources_keep_their_kernels(tree: Path) -> None:
    drop_stale_kernels(tree)
    kernels = compiled(tree)
    assert not drop_stale_kernels(tree)
    assert all(kernel.is_file() for kernel in kernels)


@pytest.mark.parametrize("package", ["osl_env", "baselines"])
def test_a_changed_source_drops_the_kernels_of_all_packages(tree: Path, package: str) -> None:
    drop_stale_kernels(tree)
    kernels = compiled(tree)
    (tree / package / "kernels.py").write_text("x = 1 + 1\n")
    assert drop_stale_kernels(tree)
    assert not any(kernel.exists() for kernel in kernels)
    assert (tree / package / "kernels.py").is_file()


def test_a_new_source_drops_them_too(tree: Path) -> None:
    drop_stale_kernels(tree)
    kernels = compiled(tree)
    (tree / "osl_env" / "plumes").mkdir()
    (tree / "osl_env" / "plumes" / "puff.py").write_text("")
    drop_stale_kernels(tree)
    assert not any(kernel.exists() for kernel in kernels)
