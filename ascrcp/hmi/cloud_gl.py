"""The cloud drawn by OpenGL into a buffer of its own, chunk by chunk: same colours and camera as without.

The calls go through PyOpenGL, which lets the interpreter go while the driver works.
"""

import math

import numpy as np
import OpenGL

OpenGL.ERROR_CHECKING = False  # three queries a call else
from numpy.typing import NDArray  # noqa: E402
from OpenGL import GL  # noqa: E402
from OpenGL.GL import shaders  # noqa: E402
from PySide6.QtGui import QImage, QOffscreenSurface, QOpenGLContext  # noqa: E402
from PySide6.QtOpenGL import QOpenGLFramebufferObject  # noqa: E402

from ascrcp.core.errors import DeviceError  # noqa: E402
from ascrcp.hmi.camera import NEAR, Camera  # noqa: E402
from ascrcp.hmi.cloud import FADE, depth_range  # noqa: E402

FAR = 200.0
"""Points farther from the eye than this are not drawn [m]."""
POINT_PX = 2.0
STRIDE = 16
"""Bytes of a point: three floats, four bytes of colour."""

VERTEX = """#version 120
attribute vec3 place; attribute vec4 colour;
uniform mat4 view; uniform vec2 depths; uniform float fade;
varying vec3 shade;
void main() {
    gl_Position = view * vec4(place, 1.0);
    float share = clamp((gl_Position.w - depths.x) / (depths.y - depths.x), 0.0, 1.0);
    shade = colour.rgb * (1.0 - fade * share);
}"""
FRAGMENT = """#version 120
varying vec3 shade;
void main() { gl_FragColor = vec4(shade, 1.0); }"""


def view_matrix(camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """Return the matrix from the base frame to clip coordinates, rows upside down as a QImage's, (4, 4)."""
    eye, axes = camera.axes
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = axes, -axes @ eye
    across = 1.0 / math.tan(math.radians(camera.fov_deg) / 2)
    clip = np.zeros((4, 4))
    clip[0, 0], clip[1, 1] = across, -across * width / height
    clip[2, 2], clip[2, 3] = (FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
    clip[3, 2] = 1.0
    return np.asarray(clip @ view, dtype=np.float32)


class GlCloud:
    """The cloud in the graphics card's memory, drawn a chunk at a time into a frame buffer."""

    def __init__(self, chunk: int) -> None:
        """Make a context of our own; it needs no window.

        Raises:
            DeviceError: No OpenGL here.
        """
        self._chunk, self._count, self._next = chunk, 0, 0
        self._context = QOpenGLContext()
        self._surface = QOffscreenSurface()
        if not self._context.create():
            raise DeviceError("no OpenGL context can be made")
        self._surface.setFormat(self._context.format())
        self._surface.create()
        self._enter()
        program = shaders.compileProgram(
            shaders.compileShader(VERTEX, GL.GL_VERTEX_SHADER),
            shaders.compileShader(FRAGMENT, GL.GL_FRAGMENT_SHADER),
            validate=False,
        )
        self._program = int(program)
        self._at = {name: GL.glGetUniformLocation(program, name) for name in ("view", "depths", "fade")}
        self._buffer = int(GL.glGenBuffers(1))
        self._frame: QOpenGLFramebufferObject | None = None
        self._points = np.zeros((0, 3), np.float32)
        self._labels, self._table = np.zeros(0, np.uint8), np.zeros((256, 3), np.uint8)
        self._sent = 0

    def take(self, points: NDArray[np.float32], labels: NDArray[np.uint8], table: NDArray[np.uint8]) -> None:
        """Take another cloud: make room for it; each chunk is sent when it is first drawn."""
        self._points, self._labels, self._table = points, labels, table
        self._count, self._sent = len(points), 0
        self._enter()
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
        GL.glBufferData(GL.GL_ARRAY_BUFFER, STRIDE * len(points), None, GL.GL_STATIC_DRAW)

    def begin(self, camera: Camera, width: int, height: int, void: tuple[int, int, int]) -> None:
        """Begin a picture anew."""
        self._enter()
        frame = self._frame
        if frame is None or (frame.width(), frame.height()) != (width, height):
            depth = QOpenGLFramebufferObject.Attachment.Depth
            self._frame = frame = QOpenGLFramebufferObject(width, height, depth)
        frame.bind()
        GL.glViewport(0, 0, width, height)
        GL.glClearColor(*(channel / 255 for channel in void), 1.0)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        GL.glEnable(GL.GL_DEPTH_TEST)
        GL.glPointSize(POINT_PX)
        GL.glUseProgram(self._program)
        GL.glUniformMatrix4fv(self._at["view"], 1, True, view_matrix(camera, width, height))
        GL.glUniform2f(self._at["depths"], *depth_range(self._points, camera, width, height))
        GL.glUniform1f(self._at["fade"], FADE)
        self._next = 0

    def add(self) -> bool:
        """Draw the next chunk; return whether there are more."""
        assert self._frame is not None
        self._enter()
        self._frame.bind()
        count = min(self._chunk, self._count - self._next)
        if count > 0:
            GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffer)
            if self._next >= self._sent:
                self._send(slice(self._next, self._next + count))
            place, colour = (GL.glGetAttribLocation(self._program, n) for n in ("place", "colour"))
            GL.glEnableVertexAttribArray(place)
            GL.glEnableVertexAttribArray(colour)
            GL.glVertexAttribPointer(place, 3, GL.GL_FLOAT, False, STRIDE, GL.GLvoidp(0))
            GL.glVertexAttribPointer(colour, 4, GL.GL_UNSIGNED_BYTE, True, STRIDE, GL.GLvoidp(12))
            GL.glDrawArrays(GL.GL_POINTS, self._next, count)
            self._next += count
        return self._next < self._count

    def image(self) -> QImage:
        """Return the picture so far."""
        assert self._frame is not None
        width, height = self._frame.width(), self._frame.height()
        self._enter()
        self._frame.bind()
        pixels = np.empty((height, width, 4), np.uint8)
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 4)
        GL.glReadPixels(0, 0, width, height, GL.GL_BGRA, GL.GL_UNSIGNED_BYTE, pixels)
        return QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32).copy()

    def close(self) -> None:
        """Give buffer and frame back while the context is still there."""
        self._enter()
        GL.glDeleteBuffers(1, [self._buffer])
        GL.glDeleteProgram(self._program)
        self._frame = None
        self._context.doneCurrent()
        self._surface.destroy()

    def _send(self, chunk: slice) -> None:
        points = np.ascontiguousarray(self._points[chunk], np.float32)
        rows = np.full((len(points), STRIDE), 255, np.uint8)
        rows[:, :12] = points.view(np.uint8).reshape(-1, 12)
        rows[:, 12:15] = self._table[self._labels[chunk]]
        GL.glBufferSubData(GL.GL_ARRAY_BUFFER, STRIDE * chunk.start, rows.nbytes, rows)
        self._sent = chunk.stop

    def _enter(self) -> None:
        if not self._context.makeCurrent(self._surface):
            raise DeviceError("the OpenGL context was lost")
