"""The pulse in one hold. `presses` goes through them, `search` finds what beats, `causes` tells a
pulse from breathing, motion, a line and tremor, `has_pulse` decides.
"""
