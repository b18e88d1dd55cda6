"""Compiled system: flat tables, kernels, integrators and the sparse KKT solver."""
