"""The scan that every run of the campaign makes, and its limits."""

MAX_FORCE_N = 1.6
HARDEST_N_M = 6e3  # what the rig is told; some beds are twice as hard
MAX_DEPTH_M = 3.0e-3
INDENTATION_M, RAMP_S, HOLD_S = 2.5e-3, 0.4, 0.5
START_M, PITCH_M, STATIONS = 10e-3, 6e-3, 2
RETRACT_M = 2e-3
