"""The scene file: `scene_file` has its keys, `indenter` the finger, `inclusion` what lies in the
tissue, `waves` the lumen pressure.
"""
