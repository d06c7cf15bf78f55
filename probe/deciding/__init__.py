"""Planners that stand on detection: they choose the next press by what the scan shows so far."""
