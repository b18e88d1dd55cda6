"""Inertia, markers and motion of bodies, with their tangents."""
