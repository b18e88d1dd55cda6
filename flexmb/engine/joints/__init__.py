"""Constraint rows, joints, drivers, couplers, curves and scalar coordinates."""
