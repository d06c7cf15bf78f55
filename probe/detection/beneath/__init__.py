"""What lies beneath a row, how deep, how large, how stiff: `row_data` of a row's presses, which
`hypotheses` compares with a touch table beside the `nuisance` of surface and rig; `posterior`
samples. `weighed` says how likely nothing, a body or something else is, `row_evidence` which object
that is; `rivals` says which bodies objects are, `narrowing` takes two rows of one vessel, `explain`
puts them together, `stated` gives the numbers.
"""
