"""How often a scan over nothing may find something."""

DEFAULT_FALSE_ALARM = 0.02
"""Chance per scan. It is a choice, not a measurement: `--false-alarm` and ``palpate.detect`` take
another, and docs/explanation/detection.md says what 1 % and 2 % find."""
