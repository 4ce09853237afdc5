"""The bytes of a glTF file: buffers, accessors, images (glTF 2.0, sections 3.6 and 3.8.4)."""

from __future__ import annotations

import base64
import binascii
import json
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from mbinterval.errors import SceneError
from mbinterval.files.contents import read_file
from mbinterval.scene.formats.gltf.check import COMPONENTS, SHAPES, check_document

_FEW_ZEROS = 2**10
"""Elements of an accessor without data, where none has data that say how many there may be."""


class GltfData:
    """A parsed glTF file and lazy access to the data that it refers to.

    Attributes
    ----------
    document
        The JSON part as pygltflib's records.
    path
        The file; what it names is relative to its folder.
    node_weights
        Morph weights of those nodes that give their own, by the node's index; pygltflib drops
        them.
    """

    def __init__(self, path: Path) -> None:
        from pygltflib import GLTF2

        self.path = path
        data = read_file(path)
        binary = data[:4] == b"glTF"
        if binary and data[16:20] != b"JSON":
            raise SceneError("its first chunk is not JSON; the file is damaged or not glTF 2.0")
        text = data[20 : 20 + int.from_bytes(data[12:16], "little")] if binary else data
        tree = _parsed(text)
        check_document(tree)
        self.document: Any = (
            GLTF2.load_from_bytes(data)
            if binary
            else GLTF2.from_json(text.decode("utf-8-sig"), infer_missing=True)
        )
        if self.document is None:
            raise SceneError("has no JSON chunk; the file is cut off or not glTF 2.0")
        self.node_weights: dict[int, list[float]] = {
            index: node["weights"]
            for index, node in enumerate(tree.get("nodes") or ())
            if node.get("weights")
        }
        if not str(self.document.asset.version or "").startswith("2"):
            raise SceneError(f"is glTF {self.document.asset.version!r}; only 2.x can be read")

    def accessor(self, index: int) -> NDArray[Any]:
        """Elements of an accessor, ``(count,)`` for scalars, else ``(count, components)``.

        Normalized integers become float64 in [0, 1] or [-1, 1]; matrices are ``(count, n, n)``
        with the usual rows and columns.
        """
        accessor = item_at(self.document.accessors, index, "accessor")
        columns, rows = SHAPES[accessor.type]
        kind = np.dtype(COMPONENTS[accessor.componentType])
        if accessor.bufferView is None:
            given = [
                other.count for other in self.document.accessors if other.bufferView is not None
            ]
            if accessor.count > max(given, default=_FEW_ZEROS):
                raise SceneError(
                    f"accessors[{index}] has {accessor.count} elements and no data, more than any "
                    "that has; the file is damaged"
                )
            values = np.zeros((accessor.count, columns, rows), kind)
        else:
            values = self._strided(index, kind, columns, rows)
        if accessor.sparse is not None:
            values = self._with_sparse(values, accessor.sparse, kind)
        if accessor.normalized and kind.kind in "iu":
            values = np.maximum(values / float(np.iinfo(kind).max), -1.0)
        if columns > 1:
            return values.swapaxes(1, 2)
        return values[:, 0, 0] if rows == 1 else values[:, 0, :]

    def _strided(self, index: int, kind: np.dtype[Any], columns: int, rows: int) -> NDArray[Any]:
        accessor = self.document.accessors[index]
        view, data = self._view(accessor.bufferView)
        # Columns of matrices start at multiples of four bytes.
        column = rows * kind.itemsize if columns == 1 else -(-rows * kind.itemsize // 4) * 4
        stride = view.byteStride or column * columns
        offset = accessor.byteOffset or 0
        if accessor.count < 1 or offset < 0 or stride < 0:
            raise SceneError(f"accessors[{index}] has count {accessor.count} at offset {offset}")
        needed = offset + (accessor.count - 1) * stride + (columns - 1) * column
        if needed + rows * kind.itemsize > len(data):
            raise SceneError(
                f"accessors[{index}] of {accessor.count} elements ends after its buffer view of "
                f"{len(data)} bytes; the file is damaged or cut off"
            )
        shape, strides = (accessor.count, columns, rows), (stride, column, kind.itemsize)
        return np.ndarray(shape, kind, buffer=data, offset=offset, strides=strides)

    def _with_sparse(self, values: NDArray[Any], sparse: Any, kind: np.dtype[Any]) -> NDArray[Any]:
        _, where = self._view(sparse.indices.bufferView)
        _, what = self._view(sparse.values.bufferView)
        places = np.frombuffer(
            where,
            COMPONENTS[sparse.indices.componentType],
            sparse.count,
            sparse.indices.byteOffset or 0,
        )
        size = values.shape[1] * values.shape[2]
        new = np.frombuffer(what, kind, sparse.count * size, sparse.values.byteOffset or 0)
        values = values.copy()
        values[places] = new.reshape(-1, *values.shape[1:])
        return values

    def _view(self, index: int) -> tuple[Any, memoryview]:
        view = item_at(self.document.bufferViews, index, "buffer view")
        if (view.extensions or {}).keys() & {"EXT_meshopt_compression"}:
            raise SceneError("is meshopt-compressed; export it without EXT_meshopt_compression")
        buffer = self._buffers[view.buffer] if view.buffer < len(self._buffers) else b""
        start = view.byteOffset or 0
        if start < 0 or view.byteLength < 0 or start + view.byteLength > len(buffer):
            raise SceneError(
                f"buffer view {index} ends after its buffer of {len(buffer)} bytes; "
                "the file is damaged or cut off"
            )
        return view, memoryview(buffer)[start : start + view.byteLength]

    @cached_property
    def _buffers(self) -> list[bytes]:
        blob = self.document.binary_blob() or b""
        uris = [buffer.uri for buffer in self.document.buffers]
        return [self._resource(uri) if uri else blob for uri in uris]

    def image(self, index: int) -> tuple[bytes, str]:
        """Encoded bytes of an image, and a name for it; raises ``FileNotFoundError``."""
        image = item_at(self.document.images, index, "image")
        if image.uri:
            name = image.name or ("" if image.uri.startswith("data:") else image.uri)
            return self._resource(image.uri), name or str(index)
        return bytes(self._view(image.bufferView)[1]), image.name or str(index)

    def _resource(self, uri: str) -> bytes:
        """Bytes behind a data URI or a path relative to the file."""
        if uri.startswith("data:"):
            header, _, body = uri.partition(",")
            if not header.endswith(";base64"):
                return unquote_to_bytes(body)
            try:
                return base64.b64decode(body)
            except binascii.Error as error:
                raise SceneError(f"a data URI is damaged ({error})") from None
        if "://" in uri:
            raise SceneError(f"{uri} is not a local file; download it beside the model")
        return read_file(self.path.parent / unquote(uri))


def _parsed(text: bytes) -> Any:
    """JSON of a file; a syntax error gives line and column."""
    try:
        return json.loads(text.decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        where = f"at line {error.lineno}, column {error.colno}"
        raise SceneError(
            f"not a readable glTF file: {error.msg} ({where} of its JSON); export it again"
        ) from None
    except UnicodeDecodeError as error:
        raise SceneError(
            f"not a readable glTF file: its JSON is not UTF-8 ({error}); export it again"
        ) from None


def item_at(items: Any, index: Any, what: str) -> Any:
    """``items[index]`` with a message; a negative index of a damaged file must not wrap."""
    if not isinstance(index, int) or not 0 <= index < len(items or ()):
        raise SceneError(f"{what} {index!r} does not exist; the file is damaged")
    return items[index]
