"""Gaps and normals between bodies, and which pairs touch (`pairs`); `fem.newton` solves with
them.
"""
