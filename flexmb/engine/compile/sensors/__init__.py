"""Tables of sensors and of functions over their channels."""
