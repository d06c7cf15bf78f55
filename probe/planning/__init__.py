"""Where and how to press, before anything moves: `plan` places and orders the stations,
`press_direction` turns each press to the surface's normal, `surfaces` gives its height, `limits`
is what a rig is held to.
"""
