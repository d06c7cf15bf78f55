"""How a press's force changes with each number of its scene, in newtons."""

from sim_backend.fem.newton import Solution
from sim_backend.fem.section import Section
from sim_backend.fem.sensitivity import gradients
from sim_backend.models.choose import Choice
from sim_backend.scene.scene_file import Scene, SceneError


def with_gradient(model: str, scene: Scene) -> Choice:
    """The model of a press whose gradient is asked for. Raises `SceneError` for another."""
    known = "solid" if scene.plane == "solid" else "finite"
    if model not in ("auto", known):
        raise SceneError(
            f"model = {model!r}: gradients are of finite strain, in a plane or of a solid; take "
            f"{known}, or leave model out"
        )
    if known == "solid" and any(one.path for one in scene.arteries):
        raise SceneError(f"{scene.name}: gradients of a vessel with a path are not known")
    return Choice(known, scene, 0.0, why="gradients are of finite strain")


def force_gradient_n(scene: Scene, section: Section, solution: Solution) -> dict[str, float]:
    """A section's force on the whole finger [N] by each key of
    `sim_backend.fem.sensitivity.gradients`, per unit of that. Raises `SingularMatrix`."""
    length_m = 1e-3 * scene.indenter.length_mm
    found = {key: length_m * by for key, by in gradients(section, solution, scene).items()}
    return found | {"indenter.length_mm": 1e-3 * solution.force}
