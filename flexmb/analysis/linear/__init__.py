"""The linearised equations of motion at a state: matrices, modes, state space."""
