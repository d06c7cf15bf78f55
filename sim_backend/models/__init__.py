"""From a scene to a force: `place` is one solved place, `table` the models to choose from,
`press` what a person asks of it.
"""
