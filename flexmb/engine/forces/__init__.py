"""Forces on markers and coordinates, with their tangents, energies and memory."""
