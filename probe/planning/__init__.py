"""Where and how to press, before anything moves: `plan` orders the stations, `limits` and
`surfaces` bound them.
"""
