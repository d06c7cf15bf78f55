"""What all rooms of `probe` share: `events` of a run, `recording` and how it is cut into
stations, errors, places, words.
"""
