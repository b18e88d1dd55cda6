"""The user's description of a machine: bodies, joints, drivers, forces, sensors as validated data.

No numerics live here: the engine compiles a :class:`Model` together with its flexible bodies.
"""

from flexmb.model.model import Model
from flexmb.model.scenes.scene import as_model, describe, load_scene, scene_schema

__all__ = ["Model", "as_model", "describe", "load_scene", "scene_schema"]
