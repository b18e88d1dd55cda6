"""What is measured: sensors, expressions over their channels, states, controllers."""
