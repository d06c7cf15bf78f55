"""The run file. `schema` is its layout, `rows` has check sums and what an event is as a row,
`writer` and `reader` go to and from the disk, `moved_away` notices what happens to it meanwhile,
`verify` judges the whole, `audit` whether its events agree; `export` and `csv_import` lead out and
in.
"""
