"""Analyses of a compiled model: assembly, mobility, kinematics, dynamics."""
