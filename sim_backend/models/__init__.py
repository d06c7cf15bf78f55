"""From a scene to a force: `table` chooses how a press is solved, `stations` solve a place once,
`press` what a person asks of it.
"""
