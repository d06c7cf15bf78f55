"""Windows on a run: while it happens, afterwards, and on the phantom. Each is its own process."""
