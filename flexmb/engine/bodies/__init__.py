"""Rigid and flexible bodies and their markers."""
