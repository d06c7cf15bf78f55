"""The third dimension: `build` meshes a block, `body` is what Newton's method asks of it, `solve`
presses.
"""
