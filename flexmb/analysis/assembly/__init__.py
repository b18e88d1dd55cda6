"""The first state: positions closed, velocities, accelerations."""
