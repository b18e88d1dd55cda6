"""Solving with large sparse stiffness matrices."""
