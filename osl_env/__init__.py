"""osl-env."""
