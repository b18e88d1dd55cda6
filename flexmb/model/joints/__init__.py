"""What connects and moves bodies: joints, couplers, curves, drivers."""
