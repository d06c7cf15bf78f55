"""How deep, how large, how stiff: `row_data` of a row's presses, `hypotheses` compares it with a
touch table, `posterior` samples, `rivals` says which bodies there are, `explain` how large.
"""
