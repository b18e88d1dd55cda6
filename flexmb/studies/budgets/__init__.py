"""Error budgets: the contribution of each knob to the error of each sensor."""
