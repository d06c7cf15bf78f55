"""How deep, how large, how stiff: `row_data` of a row's presses, `hypotheses` compares it with a
touch table, `posterior` samples, `rivals` says which bodies there are, `narrowing` takes two rows
of one vessel, `explain` puts them together, `stated` gives the numbers.
"""
