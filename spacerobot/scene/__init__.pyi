"""Public names and their modules; :mod:`spacerobot.common.lazy_names` loads a name when it is first used."""

from spacerobot.scene.build import build_scene as build_scene
from spacerobot.scene.load import load_scene as load_scene
from spacerobot.scene.load import to_scene as to_scene
from spacerobot.scene.scene import Scene as Scene
from spacerobot.scene.scene import SceneBody as SceneBody
from spacerobot.scene.scene import SceneGrasp as SceneGrasp
from spacerobot.scene.scene import SceneReference as SceneReference
from spacerobot.scene.scene import SceneTip as SceneTip
