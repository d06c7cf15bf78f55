"""The rig file: `rig` has its keys, `load_rig` reads it, `scan_plan` makes the stations and
`scan_limits` what they may never exceed, `devices` opens the drivers.
"""
