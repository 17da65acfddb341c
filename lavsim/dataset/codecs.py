"""How sensor readings become bytes: a table of codecs by name, which the schema names for every field.

Sizes and times per frame of the `lav_data` suite (31,000 points, five images 256 x 288 and one 480 x 288, bench scene,
one core):

    field       codec           kB     encode ms  decode ms
    lidar       lidar_cm        60     0.4        0.2
    colour x 6  jpeg90          87     2.0        2.2         (q90 4:2:0: 70 kB, but a far red light turns grey)
    tags x 6    zstd            13     0.1        0.1
    bev         packbits_zstd   1.1    0.03       0.03
"""

from __future__ import annotations

import io
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import zstandard
from numpy.typing import NDArray

from lavsim.errors import DatasetError, UnknownName
from lavsim.kernel import kernel

cv2.setNumThreads(1)

_LEVEL = 1  # level 3 saves 3 % of a LiDAR scan and takes twice as long
_COUNT = 7  # bytes of a LiDAR point before zstd
_CENTIMETRES = 100.0
_FARTHEST = 327.67  # [m] that 16 bits of centimetres hold
_JPEG = [
    int(cv2.IMWRITE_JPEG_QUALITY), 90,
    int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR), int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
]  # fmt: skip

Shape = tuple[int | str, ...]


@dataclass(frozen=True)
class Codec:
    """A way to store an array.

    Attributes:
        suffix: Of the file's name in a shard.
        encode: Bytes of an array.
        decode: The array of bytes; the shape is that of the field, where the bytes do not tell.
        about: How to decode without this library.
    """

    suffix: str
    encode: Callable[[NDArray[Any]], bytes]
    decode: Callable[[bytes, Shape], NDArray[Any]]
    about: str


def find_codec(name: str) -> Codec:
    """The codec called `name`.

    Raises:
        DatasetError: this version knows none.
    """
    try:
        return CODECS[name]
    except KeyError:
        raise DatasetError(str(UnknownName("codec", name, CODECS))) from None


def decode(name: str, data: bytes, shape: Shape) -> NDArray[Any]:
    """The array that codec `name` made `data` of.

    Raises:
        DatasetError: the bytes are not such an array's.
    """
    codec = find_codec(name)
    try:
        return codec.decode(data, shape)
    except (zstandard.ZstdError, cv2.error, ValueError, EOFError) as error:
        raise DatasetError(f"not what codec {name!r} gives: {error}") from None


def _encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    done, data = cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _JPEG)
    if not done:
        raise DatasetError("an image could not be packed as JPEG.")
    return data.tobytes()


def _decode_jpeg(data: bytes, shape: Shape) -> NDArray[np.uint8]:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError("no JPEG")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def _encode_bytes(array: NDArray[np.uint8]) -> bytes:
    return _pack(np.ascontiguousarray(array))


def _decode_bytes(data: bytes, shape: Shape) -> NDArray[np.uint8]:
    return _unpack(data).reshape(_sizes(shape)).copy()


def _encode_bits(layers: NDArray[np.uint8]) -> bytes:
    return _pack(np.packbits(layers, axis=None))


def _decode_bits(data: bytes, shape: Shape) -> NDArray[np.uint8]:
    sizes, packed = _sizes(shape), _unpack(data)
    count = math.prod(sizes)
    if len(packed) != -(-count // 8):  # numpy would make up what lacks
        raise ValueError(f"{len(packed)} bytes do not hold {count} bits")
    bits = np.unpackbits(packed, count=count)
    return np.negative(bits, out=bits).reshape(sizes)  # 0 or 255


def _encode_lidar(points: NDArray[np.float32]) -> bytes:
    points = np.ascontiguousarray(points, np.float32)
    if len(points) and not np.abs(points[:, :3]).max() <= _FARTHEST:
        raise DatasetError(f"LiDAR points farther than {_FARTHEST} m do not fit the codec 'lidar_cm'.")
    return _pack(_lidar_planes(points))


def _decode_lidar(data: bytes, shape: Shape) -> NDArray[np.float32]:
    planes = _unpack(data)
    if len(planes) % _COUNT:
        raise ValueError(f"{len(planes)} bytes are no number of points")
    points: NDArray[np.float32] = _lidar_points(planes, len(planes) // _COUNT)
    return points


def _encode_any(array: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array(file, np.ascontiguousarray(array), version=(1, 0), allow_pickle=False)
    return _pack(np.frombuffer(file.getbuffer(), np.uint8))


def _decode_any(data: bytes, shape: Shape) -> NDArray[Any]:
    array: NDArray[Any] = np.lib.format.read_array(io.BytesIO(_unpack(data).tobytes()), allow_pickle=False)
    return array


class _Contexts(threading.local):
    """Zstandard's working memory, one a thread: making it anew takes longer than packing an image of tags."""

    def __init__(self) -> None:
        self.packer = zstandard.ZstdCompressor(level=_LEVEL)
        self.unpacker = zstandard.ZstdDecompressor()


_contexts = _Contexts()


def _pack(values: NDArray[np.uint8]) -> bytes:
    packed: bytes = _contexts.packer.compress(values.data)
    return packed


def _unpack(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(_contexts.unpacker.decompress(data), np.uint8)


def _sizes(shape: Shape) -> tuple[int, ...]:
    return tuple(int(size) for size in shape)


@kernel
def _lidar_planes(points):  # type: ignore[no-untyped-def]
    """(7 N,) bytes of points (N, 4): neighbours' differences, sign in the lowest bit, low and high bytes apart."""
    count = len(points)
    planes = np.empty(_COUNT * count, np.uint8)
    for axis in range(3):
        low, high, before = 2 * axis * count, (2 * axis + 1) * count, 0
        for n in range(count):
            value = int(np.rint(points[n, axis] * _CENTIMETRES))
            step = ((value - before + 32768) & 65535) - 32768
            word = (step << 1) ^ (step >> 63)
            planes[low + n], planes[high + n] = word & 255, (word >> 8) & 255
            before = value
    before = 0
    for n in range(count):
        value = min(max(int(np.rint(points[n, 3] * 255.0)), 0), 255)
        planes[6 * count + n] = (value - before) & 255
        before = value
    return planes


@kernel
def _lidar_points(planes, count):  # type: ignore[no-untyped-def]
    """(N, 4) points of `_lidar_planes`."""
    points = np.empty((count, 4), np.float32)
    for axis in range(3):
        low, high, value = 2 * axis * count, (2 * axis + 1) * count, 0
        for n in range(count):
            word = int(planes[low + n]) | (int(planes[high + n]) << 8)
            value = ((value + ((word >> 1) ^ -(word & 1)) + 32768) & 65535) - 32768
            points[n, axis] = value / _CENTIMETRES
    value = 0
    for n in range(count):
        value = (value + planes[6 * count + n]) & 255
        points[n, 3] = value / 255.0
    return points


CODECS: dict[str, Codec] = {
    "jpeg90": Codec("jpg", _encode_jpeg, _decode_jpeg, "JPEG, quality 90, no chroma subsampling (4:4:4)"),
    "zstd": Codec("zst", _encode_bytes, _decode_bytes, "Zstandard over the array's bytes, row by row"),
    "packbits_zstd": Codec(
        "bits", _encode_bits, _decode_bits,
        "Zstandard over bits, the first in the highest place of a byte (numpy.unpackbits); a 1 stands for 255",
    ),
    "lidar_cm": Codec(
        "bin", _encode_lidar, _decode_lidar,
        "Zstandard over seven planes of N bytes: low and high bytes of x, of y, of z, then intensity. A word w of x, y "
        "or z stands for the step (w >> 1) ^ -(w & 1) from the point before, modulo 65536 and signed [cm]; an "
        "intensity byte for the step modulo 256 [1/255]",
    ),
    "npy_zstd": Codec("npyz", _encode_any, _decode_any, "Zstandard over a file in NumPy's NPY format"),
}  # fmt: skip
