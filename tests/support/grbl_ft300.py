"""The rig of an emulated GRBL board and FT-300, at the addresses ``board`` and ``sensor``."""

DEVICES = """
face_mm2 = 100.0
[stage]
driver = "grbl"
port = "{board}"
simulated = true
origin_mm = [-80.0, -20.0, -52.0]
answer_s = 5.0
silent_s = 5.0
[[sensor]]
driver = "ft300"
port = "{sensor}"
simulated = true
"""
