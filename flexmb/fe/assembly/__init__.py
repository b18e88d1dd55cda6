"""From elements to matrices: numbering, stiffness, mass, inertia, geometric stiffness, loads."""
