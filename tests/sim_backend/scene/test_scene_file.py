"""docs/reference/scene-file.md: its scene can be read as written, and no key is missing there."""

import re

import pytest
from paths import ROOT
from pydantic import BaseModel

from sim_backend.scene.inclusion import Artery, Stenosis, Tumour
from sim_backend.scene.indenter import Cylinder, Flat, Punch, Skin, Sphere
from sim_backend.scene.scene_file import Pulse, Scene, Tissue, scene_from_text

DOC = (ROOT / "docs" / "reference" / "scene-file.md").read_text(encoding="utf-8")


def test_the_scene_shown_can_be_read() -> None:
    shown = re.search(r"```toml\n(.*?)```", DOC, re.DOTALL)
    assert shown is not None
    scene = scene_from_text(shown[1], "docs/reference/scene-file.md")
    assert [one.kind for one in scene.inclusion] == ["artery", "tumour"]
    assert scene.indenter.skin is not None


@pytest.mark.parametrize(
    "table", [Artery, Cylinder, Flat, Pulse, Punch, Scene, Skin, Sphere, Stenosis, Tissue, Tumour]
)
def test_no_key_is_missing(table: type[BaseModel]) -> None:
    assert [key for key in table.model_fields if not re.search(rf"\b{key}\b", DOC)] == []
