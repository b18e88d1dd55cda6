"""Forces: loads, springs and laws, bushings and beams, stops, contact, friction."""
