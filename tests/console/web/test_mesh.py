"""The vehicle's looks as a glTF file: what is in it is what the pieces are."""

import json
import struct

import numpy as np
import pytest

from rovtwin.console.web.mesh import vehicle_glb
from rovtwin.simulation.scene.bodies import vehicle_meshes
from rovtwin.vehicle import load_vehicle


def read(glb):
    """Description and arrays (one for each accessor) of a GLB file; its chunks must fill it exactly."""
    magic, version, length = struct.unpack_from("<4sII", glb)
    assert (magic, version, length) == (b"glTF", 2, len(glb))
    size, kind = struct.unpack_from("<I4s", glb, 12)
    assert kind == b"JSON" and size % 4 == 0
    description = json.loads(glb[20 : 20 + size])
    rest, kind = struct.unpack_from("<I4s", glb, 20 + size)
    assert kind == b"BIN\0" and 28 + size + rest == len(glb)
    data, arrays = glb[28 + size :], []
    for accessor in description["accessors"]:
        view = description["bufferViews"][accessor["bufferView"]]
        raw = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        array = np.frombuffer(raw, {5126: "<f4", 5125: "<u4"}[accessor["componentType"]])
        arrays.append(array.reshape(accessor["count"], {"VEC3": 3, "SCALAR": 1}[accessor["type"]]))
    return description, arrays


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


def test_every_triangle_is_there_once(vehicle):
    description, arrays = read(vehicle_glb(vehicle))
    triangles = []
    for primitive in description["meshes"][0]["primitives"]:
        vertices = arrays[primitive["attributes"]["POSITION"]]
        index = arrays[primitive["indices"]].ravel()
        assert index.max() < len(vertices) == len(arrays[primitive["attributes"]["NORMAL"]])
        triangles.append(vertices[index].reshape(-1, 9))
    meshes = vehicle_meshes(vehicle, np.zeros(3), np.eye(3))
    expected = np.concatenate([mesh.vertices[mesh.triangles].reshape(-1, 9) for mesh in meshes])
    found = np.concatenate(triangles).astype(float)
    assert len(found) == len(expected)
    np.testing.assert_allclose(found.sum(axis=0), expected.sum(axis=0), rtol=1e-6, atol=1e-4)
    np.testing.assert_allclose((found**2).sum(axis=0), (expected**2).sum(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.reshape(-1, 3).max(axis=0), expected.reshape(-1, 3).max(axis=0), atol=1e-6)
    np.testing.assert_allclose(found.reshape(-1, 3).min(axis=0), expected.reshape(-1, 3).min(axis=0), atol=1e-6)


def test_one_primitive_a_colour_and_small_enough_for_a_phone(vehicle):
    glb = vehicle_glb(vehicle)
    description, _ = read(glb)
    colours = [tuple(m["pbrMetallicRoughness"]["baseColorFactor"]) for m in description["materials"]]
    assert len(set(colours)) == len(colours) == len(description["meshes"][0]["primitives"]) > 2
    assert len(glb) < 2_000_000


def test_vehicle_without_looks_has_no_file():
    assert vehicle_glb(load_vehicle("bluerov2")) is None
