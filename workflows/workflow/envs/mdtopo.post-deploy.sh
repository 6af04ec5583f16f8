#!/usr/bin/env bash
# mdtopo stands in no package index: it is installed from a checkout or a wheel.
set -euo pipefail
: "${MDTOPO_SOURCE:?set MDTOPO_SOURCE to a checkout or a wheel of mdtopo}"
python -m pip install "$MDTOPO_SOURCE"
