"""The simulation: scenes, finite elements and the phantom that joins them."""

from sim_backend.scene.scene_file import Scene, SceneError, load_scene, scene_names

__all__ = ["Scene", "SceneError", "load_scene", "scene_names"]
