"""Finite elements of the section and of revolution: `model` puts together, `newton` solves
equilibrium with contact, whose gaps are in `contact`; `solid` has the third dimension, `io`
writes for other codes.
"""
