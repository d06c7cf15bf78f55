"""The third dimension: `build` meshes a block, `newton` solves it with contact, `solve` presses."""
