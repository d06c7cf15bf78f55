"""Rig files as a person writes them."""

from pathlib import Path

VIRTUAL = """
[stage]
driver = "virtual"
[[sensor]]
driver = "virtual"
"""


def rig_file(folder: Path, scene: str = "TI", *, more: str = "", **scan: object) -> Path:
    """A virtual rig over a scene; ``scan`` are keys of its table, ``more`` what else is in it."""
    keys = "".join(f"{key} = {value}\n" for key, value in scan.items())
    path = folder / "rig.toml"
    path.write_text(f'{VIRTUAL}[scan]\n{keys}{more}[scene]\nname = "{scene}"\n', encoding="utf-8")
    return path
