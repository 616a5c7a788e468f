"""Scenes: what stands in the water around a vehicle, and how it looks. Depends on `core` and `vehicle`.

A scene file says it, a Scene holds it, `Scene.rectangles` and `Scene.meshes` are what `simulation.camera` draws.
"""

from rovtwin.simulation.scene.scene import Scene, is_scene_file, list_scenes, load_scene, scene_from_dict, scene_schema

__all__ = ["Scene", "is_scene_file", "list_scenes", "load_scene", "scene_from_dict", "scene_schema"]
