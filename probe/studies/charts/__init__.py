"""Charts of the finite-element backend: speed against accuracy, and where each model breaks."""
