"""The rig file: `rig` has its keys, `load_rig` reads it, `scan_plan` makes the stations,
`devices` opens the drivers.
"""
