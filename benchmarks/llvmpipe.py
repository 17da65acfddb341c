"""Tags and depth of a mesh by OpenGL without a graphics card, beside our own kernels (`benchmarks/sensors.py`).

Needs `pip install moderngl glcontext` and Mesa's software driver (Debian: libegl1, libegl-mesa0, libgl1-mesa-dri). For
a fair ratio start it with LP_NUM_THREADS=0, which keeps llvmpipe on one thread, and LIBGL_ALWAYS_SOFTWARE=1.
"""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from tests.meshes import GROUND, Meshes

NEAR, FAR = 0.1, 3000.0  # [m]
_VERTEX = """#version 330
in vec3 place; in int tag;
uniform mat4 lens;
flat out int what;
void main() { what = tag; gl_Position = lens * vec4(place, 1.0); }
"""
_FRAGMENT = """#version 330
flat in int what;
out uint seen;
void main() { seen = uint(what); }
"""


class Picture:
    """A buffer of tags and one of depths, and a mesh that is drawn into them.

    Args:
        width, height, focal: The camera [px].
    """

    def __init__(self, width: int, height: int, focal: float) -> None:
        self._gl: Any = moderngl.create_context(standalone=True, backend="egl")
        self.renderer = str(self._gl.info["GL_RENDERER"])
        self._shape, self._focal = (height, width), focal
        self._program = self._gl.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self._depth = self._gl.depth_texture((width, height))
        self._frame = self._gl.framebuffer([self._gl.texture((width, height), 1, dtype="u1")], self._depth)
        self._mesh: Any = None

    def load(self, meshes: Meshes) -> None:
        """Hands the triangles over; tags count from 1, 0 is ground and sky."""
        owners = meshes.owners
        tags = np.where(owners == GROUND, 0, meshes.tags[np.maximum(owners, 0)]).astype(np.int32)
        vertices = np.zeros(3 * len(owners), [("place", "<f4", 3), ("tag", "<i4")])
        vertices["place"], vertices["tag"] = meshes.corners.reshape(-1, 3), np.repeat(tags, 3)
        self._mesh = self._gl.vertex_array(self._program, [(self._gl.buffer(vertices), "3f 1i", "place", "tag")])

    def draw(self, axes: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """(H, W) tags and OpenGL depths, read back, of a camera at the meshes' eye with these axes."""
        height, width = self._shape
        lens = np.array([
            [0.0, 2.0 * self._focal / width, 0.0, 0.0],
            [0.0, 0.0, 2.0 * self._focal / height, 0.0],
            [(FAR + NEAR) / (FAR - NEAR), 0.0, 0.0, -2.0 * FAR * NEAR / (FAR - NEAR)],
            [1.0, 0.0, 0.0, 0.0],
        ])  # fmt: skip
        turn = np.eye(4)
        turn[:3, :3] = axes.T
        self._program["lens"].write((lens @ turn).T.astype(np.float32).tobytes())
        self._frame.use()
        self._gl.enable(moderngl.DEPTH_TEST)
        self._frame.clear(depth=1.0)
        self._mesh.render()
        tags = np.frombuffer(self._frame.read(components=1, dtype="u1", alignment=1), np.uint8)
        depths = np.frombuffer(self._depth.read(alignment=1), np.float32)
        return tags.reshape(self._shape)[::-1], depths.reshape(self._shape)[::-1]
