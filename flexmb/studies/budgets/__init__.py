"""Error budgets: what each knob contributes to the error of each sensor."""
