"""The picture of a planned scan's way."""

from pathlib import Path

from probe.checks.tip_path import draw_path
from probe.config.rig import default_rig


def test_the_path_is_drawn(tmp_path: Path) -> None:
    draw_path(default_rig(), tmp_path / "path.png")
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")
