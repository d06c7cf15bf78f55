"""The texts of scene files of a user's own."""

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

BALL = """name = "a ball on a block"
plane = "solid"
[tissue]
width_mm = 64.0
height_mm = 16.83
length_mm = 40.0
modulus_kpa = {modulus_kpa}
poisson = 0.49
[indenter]
shape = "sphere"
radius_mm = 5.0
"""
