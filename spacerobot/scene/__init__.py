"""The scene: robots and target in one Pinocchio model."""

from spacerobot.scene.build import build_scene, load_scene
from spacerobot.scene.scene import Scene, SceneBody, SceneGrasp, SceneReference, SceneTip

__all__ = ["Scene", "SceneBody", "SceneGrasp", "SceneReference", "SceneTip", "build_scene", "load_scene"]
