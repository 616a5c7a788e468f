"""A vehicle's looks as a glTF file for the browser, from the pieces that `rovtwin vehicle urdf` shows."""

import json
import struct
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped, UInt32

from rovtwin.simulation.scene.bodies import vehicle_meshes
from rovtwin.simulation.scene.surfaces import Mesh
from rovtwin.vehicle import Vehicle

_FLOAT, _UINT = 5126, 5125  # glTF's numbers of types
_VERTICES, _INDICES = 34962, 34963  # and of what a buffer holds


def vehicle_glb(vehicle: Vehicle) -> bytes | None:
    """A binary glTF 2.0 file, or None for a vehicle without looks.

    In metres in b, x forward, y starboard, z down: not glTF's own axes, the scene view puts it into n by itself. All
    pieces of one colour are one primitive, so that a vehicle is few things to draw.

    Raises:
        ConfigError: A mesh file that the vehicle names is not there.
    """
    by_colour: dict[tuple[float, ...], list[Mesh]] = {}
    for mesh in vehicle_meshes(vehicle, np.zeros(3), np.eye(3)):
        by_colour.setdefault(tuple(np.round(mesh.material.colour, 4).tolist()), []).append(mesh)
    if not by_colour:
        return None
    data, views, accessors, primitives, materials = b"", [], [], [], []

    def stored(array: Shaped[np.ndarray, "..."], target: int, kind: str, number: int, **more: Any) -> int:
        nonlocal data
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes, "target": target})
        accessor = {"bufferView": len(views) - 1, "componentType": number, "count": len(array), "type": kind}
        accessors.append(accessor | more)
        data += array.tobytes()
        return len(accessors) - 1

    for colour, meshes in by_colour.items():
        vertices, normals, triangles = _joined(meshes)
        span = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
        attributes = {
            "POSITION": stored(vertices, _VERTICES, "VEC3", _FLOAT, **span),
            "NORMAL": stored(normals, _VERTICES, "VEC3", _FLOAT),
        }
        indices = stored(triangles, _INDICES, "SCALAR", _UINT)
        primitives.append({"attributes": attributes, "indices": indices, "material": len(materials)})
        materials.append({"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0}})
    description = {
        "asset": {"version": "2.0", "generator": "rovtwin"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": vehicle.name}],
        "meshes": [{"primitives": primitives}],
        "materials": materials,
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    return _container(json.dumps(description, separators=(",", ":")).encode(), data)


def _joined(meshes: list[Mesh]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], UInt32[np.ndarray, " m"]]:
    """Vertices and normals, float32, and indices, uint32."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    index = [(mesh.triangles + start).ravel() for mesh, start in zip(meshes, starts, strict=True)]
    vertices, normals = (np.concatenate([getattr(mesh, name) for mesh in meshes]) for name in ("vertices", "normals"))
    return vertices.astype("<f4"), normals.astype("<f4"), np.concatenate(index).astype("<u4")


def _container(text: bytes, data: bytes) -> bytes:
    """The two chunks of a GLB file; each is padded to whole words, text with spaces."""
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
