"""From modal coordinates back to the mesh: displacement, rotation, stress, section forces."""
