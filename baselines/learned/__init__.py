"""Learned policies: networks trained elsewhere, kept as safetensors + YAML, and flown with numpy (no torch)."""
