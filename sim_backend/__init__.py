"""The simulation: scenes, finite elements and the phantom that joins them."""

from importlib import import_module
from typing import TYPE_CHECKING

__all__ = ["Scene", "SceneError", "load_scene", "scene_names"]

if TYPE_CHECKING:
    from sim_backend.scene.scene_file import Scene, SceneError, load_scene, scene_names
else:

    def __getattr__(name):
        """Imported when it is first used, as in `drivers`."""
        if name in __all__:
            return getattr(import_module("sim_backend.scene.scene_file"), name)
        raise AttributeError(f"module 'sim_backend' has no attribute {name!r}")
