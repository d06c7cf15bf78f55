"""The text of a scene file of a user's own."""

OWN_SCENE = """
name = "mine"
[tissue]
width_mm = 64.0
height_mm = 16.83
modulus_kpa = 50.0
poisson = 0.49
[[inclusion]]
kind = "artery"
x_mm = 32.0
depth_mm = 12.66
inner_diameter_mm = 3.76
wall_mm = 1.0
modulus_kpa = 400.0
poisson = 0.49
"""
