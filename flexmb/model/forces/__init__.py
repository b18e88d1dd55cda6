"""Forces: applied loads, springs with force characteristics, bushings, beams, stops, contact,
friction."""
