"""Studies: many presses at once, and the paper's figures."""
