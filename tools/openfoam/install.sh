#!/bin/sh
# Installs Debian's OpenFOAM (about 16 s and 300 MB without the recommended packages). Needs root.
set -eu
apt-get update
apt-get install --yes --no-install-recommends openfoam
