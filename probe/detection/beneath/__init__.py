"""What lies beneath a row, how deep, how large, how stiff: `row_data` of a row's presses, which
`hypotheses` compares with a touch table beside the `nuisance` of surface and rig; `posterior`
samples. `weighed` says how likely nothing, one body, two or something else is, `row_evidence` which
objects these are, `stated` gives their numbers. `known` is what is known of block and finger.
`narrowing` takes two rows of one vessel, `grid_sizes` the row of a map in which an object is
clearest.
"""
