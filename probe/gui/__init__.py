"""Windows on a run: while it happens, afterwards, and on the phantom. Each is its own process.

`state` has the numbers that a window shows, without Qt; `window` puts `maps`, `traces` and
`controls` together.
"""
