"""The pulse in one hold. `presses` goes through them, `possible_rates` has the band of rates that
a heart may have, `search` finds what beats in it, `causes` distinguishes a pulse from breathing,
motion, a line and tremor, `has_pulse` decides.
"""
