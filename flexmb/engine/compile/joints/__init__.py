"""Rows and coordinates of joints, drivers, couplers and curves."""
