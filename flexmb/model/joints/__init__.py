"""What holds and moves bodies: joints, couplers, curves, drivers."""
