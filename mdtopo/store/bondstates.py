"""Which edges are broken, or on the way to it, as JSON: few are, so the file lists them."""

from typing import Any

import numpy as np

from mdtopo.bonds import BondState
from mdtopo.typing import JsonObject


def bonds_to_mapping(state: BondState) -> dict[str, Any]:
    """Return the edges that are broken, and [edge, frames in a row] of those that are too long."""
    streaks = np.flatnonzero(state.streak)
    return {
        "broken": np.flatnonzero(state.broken).tolist(),
        "streak": np.stack([streaks, state.streak[streaks]], axis=1).tolist(),
    }


def bonds_from_mapping(mapping: JsonObject, n_edges: int) -> BondState:
    """Return the state that `bonds_to_mapping` wrote down."""
    state = BondState.intact(n_edges)
    state.broken[mapping["broken"]] = True
    for edge, count in mapping["streak"]:
        state.streak[edge] = count
    return state
