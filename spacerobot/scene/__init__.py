"""The scene: robots and target in one Pinocchio model."""

from spacerobot.scene.build import build_scene, load_scene
from spacerobot.scene.scene import Course, Scene, SceneBody, SceneGrasp, SceneTip

__all__ = ["Course", "Scene", "SceneBody", "SceneGrasp", "SceneTip", "build_scene", "load_scene"]
