"""Virtual cameras: pictures of a scene through a lens, with the water between. Depends on `core` and `vehicle`.

scene, camera = load_scene("mclab"), cameras_of(load_vehicle("double_blueye"))[0]
picture = renderer(scene, camera).image([0.0, 0.0, 0.7], np.eye(3))
"""
