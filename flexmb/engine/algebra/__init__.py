"""Vectors, rotations, and the factorisation of the iteration matrix, for compiled code."""
