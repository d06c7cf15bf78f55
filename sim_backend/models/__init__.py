"""From a scene to a force: `choose` picks the model by its error, `press` is one press,
`surrogate` the fast table behind a phantom.
"""
