"""Where and how to press, before anything moves: `plan` places and orders the stations,
`press_direction` turns each press to the surface's normal, `surfaces` gives its height, `limits`
names what may never be exceeded; `probe.config.scan_limits` takes the values from a rig.
"""
