"""How parent and child talk: a JSON header and the raw bytes of its arrays. Nothing that arrives is ever executed.

A message is `length of header (u32), flags (u32), length of body (u64)`, the header, then the body: the arrays' bytes
one behind the other, either in the stream or in a block of shared memory that both sides map.
"""

from __future__ import annotations

import json
import mmap
import socket
import struct
from typing import Any

import numpy as np

_PREFIX = struct.Struct("<IIQ")
_IN_SHARED = 1
_ALIGN = 64

_ARRAY, _BYTES, _TUPLE, _PAIRS = "\x00array", "\x00bytes", "\x00tuple", "\x00pairs"


class MessageError(Exception):
    """The other side sent what is no message."""


def pack(value: Any) -> tuple[bytes, list[memoryview], int]:
    """Header, buffers and total body length of nested dicts, lists, tuples, scalars, bytes and numpy arrays.

    Raises:
        TypeError: `value` holds something else.
    """
    buffers: list[memoryview] = []
    offset = 0

    def place(data: memoryview) -> int:
        nonlocal offset
        start = offset
        buffers.append(data)
        offset += -(-data.nbytes // _ALIGN) * _ALIGN
        return start

    def plain(item: Any) -> Any:
        if item is None or isinstance(item, bool | int | float | str):
            return item.item() if isinstance(item, np.generic) else item
        if isinstance(item, np.generic):
            return item.item()
        if isinstance(item, np.ndarray):
            if item.dtype.hasobject:
                raise TypeError(f"arrays of {item.dtype} can't be sent")
            array = np.ascontiguousarray(item)
            flat = array.reshape(-1).view(np.uint8).data if array.size else memoryview(b"")
            kind = array.dtype.str if array.dtype.names is None else array.dtype.descr
            return {_ARRAY: [kind, list(item.shape), place(flat)]}
        if isinstance(item, bytes | bytearray):
            return {_BYTES: [place(memoryview(item)), len(item)]}
        if isinstance(item, tuple):
            return {_TUPLE: [plain(part) for part in item]}
        if isinstance(item, list):
            return [plain(part) for part in item]
        if isinstance(item, dict):
            if all(isinstance(key, str) and not key.startswith("\x00") for key in item):
                return {key: plain(part) for key, part in item.items()}
            return {_PAIRS: [[plain(key), plain(part)] for key, part in item.items()]}
        raise TypeError(f"a {type(item).__name__} can't be sent")

    header = json.dumps(plain(value), separators=(",", ":")).encode()
    return header, buffers, offset


def unpack(header: bytes, body: Any) -> Any:
    """The value of a message; arrays are writable copies of their part of `body`."""

    def value(item: Any) -> Any:
        if isinstance(item, list):
            return [value(part) for part in item]
        if not isinstance(item, dict):
            return item
        if len(item) == 1:
            kind, content = next(iter(item.items()))
            if kind == _ARRAY:
                columns, shape, start = content
                dtype = np.dtype([tuple(c) for c in columns]) if isinstance(columns, list) else np.dtype(columns)
                if dtype.hasobject:
                    raise MessageError("arrays of objects are not accepted")
                count = int(np.prod(shape, dtype=np.int64))
                return (
                    np.frombuffer(body, dtype, count, start).reshape(shape).copy() if count else np.zeros(shape, dtype)
                )
            if kind == _BYTES:
                return bytes(body[content[0] : content[0] + content[1]])
            if kind == _TUPLE:
                return tuple(value(part) for part in content)
            if kind == _PAIRS:
                return {value(key): value(part) for key, part in content}
        return {key: value(part) for key, part in item.items()}

    try:
        return value(json.loads(header))
    except (ValueError, TypeError, KeyError, IndexError) as error:
        raise MessageError(f"unreadable message: {error}") from None


class Channel:
    """One end of a conversation over a stream socket, with a block of shared memory for one direction's bodies."""

    def __init__(self, stream: socket.socket, shared: mmap.mmap | None, limit: int = 2**33) -> None:
        self._stream = stream
        self._shared = memoryview(shared) if shared is not None else None
        self._limit = limit

    def send(self, value: Any, in_shared: bool = False) -> None:
        """Sends `value`; `in_shared` puts its arrays into the shared block where they fit."""
        header, buffers, size = pack(value)
        shared = self._shared
        if in_shared and shared is not None and size <= len(shared):
            start = 0
            for data in buffers:
                shared[start : start + data.nbytes] = data
                start += -(-data.nbytes // _ALIGN) * _ALIGN
            self._stream.sendall(_PREFIX.pack(len(header), _IN_SHARED, size) + header)
            return
        self._stream.sendall(_PREFIX.pack(len(header), 0, size) + header)
        for data in buffers:
            self._stream.sendall(data)
            self._stream.sendall(bytes(-data.nbytes % _ALIGN))

    def receive(self) -> Any:
        """The next message.

        Raises:
            EOFError: the other side is gone.
            MessageError: it sent something else, or more than the limit.
        """
        header_size, flags, size = _PREFIX.unpack(self._read(_PREFIX.size))
        if header_size + size > self._limit:
            raise MessageError(f"a message of {header_size + size} bytes is over the limit of {self._limit}")
        header = self._read(header_size)
        if flags & _IN_SHARED:
            if self._shared is None or size > len(self._shared):
                raise MessageError("a message refers to memory that is not shared")
            return unpack(bytes(header), self._shared)
        return unpack(bytes(header), self._read(size))

    def _read(self, size: int) -> bytearray:
        data = bytearray(size)
        view, done = memoryview(data), 0
        while done < size:
            got = self._stream.recv_into(view[done:])
            if not got:
                raise EOFError("the other side closed the stream")
            done += got
        return data
