"""glTF files made in code: a JSON and its bytes."""

import base64
import json
import struct

import numpy as np

from clfur.files.meshes import load_mesh

COMPONENTS = {np.dtype(kind): code for kind, code in [
    ("i1", 5120), ("u1", 5121), ("<i2", 5122), ("<u2", 5123), ("<u4", 5125), ("<f4", 5126)]}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class File:
    """A glTF file: `tree` is its JSON, `binary` its one buffer; what is added gets a number."""

    def __init__(self, **tree):
        self.tree, self.binary = {"asset": {"version": "2.0"}} | tree, b""

    def add(self, kind, **item):
        self.tree.setdefault(kind, []).append(item)
        return len(self.tree[kind]) - 1

    def view(self, data, **more):
        """Bytes at the end of the buffer, aligned to 4."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        start, data = len(self.binary), bytes(data)
        self.binary += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **more)

    def accessor(self, array, dtype=None, padded=False, **more):
        """An array [n, width] in its own bufferView; padded: elements begin at multiples of 4, as attributes must."""
        array = np.asarray(array, dtype)
        array = array.reshape(len(array), -1)
        size = array.dtype.itemsize * array.shape[1]
        if padded and size % 4:
            rows = np.zeros((len(array), size + -size % 4), np.uint8)
            rows[:, :size] = np.ascontiguousarray(array).view(np.uint8)
            view = self.view(rows.tobytes(), byteStride=rows.shape[1])
        else:
            view = self.view(array.tobytes())
        return self.describe(array.dtype, len(array), array.shape[1], bufferView=view, **more)

    def describe(self, dtype, count, width, **more):
        """An accessor of a bufferView that is there, or of none."""
        return self.add("accessors", componentType=COMPONENTS[np.dtype(dtype)], count=count, type=TYPES[width], **more)

    def sparse(self, places, values, dtype=np.uint8):
        """The `sparse` of an accessor: values [n, width] at these places."""
        return {"count": len(places), "indices": {"bufferView": self.view(np.asarray(places, dtype).tobytes()),
                                                  "componentType": COMPONENTS[np.dtype(dtype)]},
                "values": {"bufferView": self.view(np.asarray(values).tobytes())}}

    def mesh(self, attributes, indices=None, mesh=None, **primitive):
        """A primitive of accessors in a mesh of its own; or in one that is there."""
        each = {"attributes": attributes} | ({} if indices is None else {"indices": indices}) | primitive
        if mesh is None:
            return self.add("meshes", primitives=[each])
        self.tree["meshes"][mesh]["primitives"].append(each)
        return mesh

    def finished(self, uri=None):
        """The JSON with the buffer and, where there is none, a scene of all nodes that are nobody's children."""
        tree = dict(self.tree)
        if self.binary:
            tree.setdefault("buffers", [{"byteLength": len(self.binary)} | ({} if uri is None else {"uri": uri})])
        if "scenes" not in tree:
            nodes = tree.get("nodes", [])
            below = {number for node in nodes for number in node.get("children", ())}
            tree["scenes"] = [{"nodes": [k for k in range(len(nodes)) if k not in below]}]
        return tree

    def glb(self):
        return glb(self.finished(), self.binary)

    def gltf(self, uri=None):
        return json.dumps(self.finished(uri or data_uri(self.binary))).encode()


def glb(tree, binary=None):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<2I", len(text), 0x4E4F534A) + text
    if binary is not None:
        binary += b"\0" * (-len(binary) % 4)
        body += struct.pack("<2I", len(binary), 0x4E4942) + binary
    return struct.pack("<4s2I", b"glTF", 2, 12 + len(body)) + body


def data_uri(binary):
    return "data:application/octet-stream;base64," + base64.b64encode(binary).decode()


def load(folder, data, name="x.glb"):
    """The Mesh of a File, or of bytes."""
    (folder / name).write_bytes(data.glb() if isinstance(data, File) else data)
    return load_mesh(folder / name)


def corners(mesh):
    """The corners of a mesh's faces in the world, float64 [F, 3, 3]."""
    return mesh.positions[mesh.faces] + mesh.origin
