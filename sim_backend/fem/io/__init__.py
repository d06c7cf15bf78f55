"""A press for other codes: `deck` for CalculiX, `feb` for FEBio, `vtu` for ParaView; `slab` is
what decks share.
"""
