"""Draws pictures into a viewport, below its view transform.

In PRE_VIEW the framebuffer in use is the viewport's own: scene-linear colors, with depth.  In POST_VIEW it is the
overlay, in display colors.  Pictures are drawn into the first, so that the viewport's view transform applies to them.
The overlay is multiplied by what they let through: Solid and Material Preview keep the theme's background there, and
the grid and the axes behind the volume.
"""

from contextlib import contextmanager

import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from .frames import RegionPicture

VERTEX = """
void main()
{
  at = corner;
  gl_Position = vec4(mix(place.xy, place.zw, corner), 0.0, 1.0);
}
"""
# A picture of the region's own size is shown texel by texel; a coarser one is interpolated.
FRAGMENT = """
vec4 texel(ivec2 position, ivec2 last)
{
  return texelFetch(picture, clamp(position, ivec2(0), last), 0);
}

void main()
{
  ivec2 size = textureSize(picture, 0);
  vec2 position = vec2(at.x, 1.0 - at.y) * vec2(size) - 0.5;
  vec2 below = floor(position + 0.001);
  vec2 share = max(position - below, vec2(0.0));
  ivec2 first = ivec2(below);
  ivec2 last = size - 1;
  vec4 color = mix(
      mix(texel(first, last), texel(first + ivec2(1, 0), last), share.x),
      mix(texel(first + ivec2(0, 1), last), texel(first + ivec2(1, 1), last), share.x), share.y);
  shown = veil > 0.5 ? vec4(1.0 - color.a) : color;
}
"""

CORNERS = (0, 0), (1, 0), (0, 1), (1, 1)  # of the quad of a picture

_made: dict = {}  # name -> shader and quad, once a viewport was drawn


class Handlers:
    """Functions that are called while Blender draws a 3D viewport, each with when; in background mode none is."""

    def __init__(self, *functions):
        self._functions, self._handles = functions, []

    def register(self) -> None:
        if not bpy.app.background:
            for function, when in self._functions:
                self._handles.append(bpy.types.SpaceView3D.draw_handler_add(function, (), "WINDOW", when))

    def unregister(self) -> None:
        while self._handles:
            bpy.types.SpaceView3D.draw_handler_remove(self._handles.pop(), "WINDOW")


def shader_and_quad(name: str, constants: tuple, vertex: str, fragment: str, corners) -> tuple:
    """A shader that draws ``picture`` over a quad, made once; ``constants``: (type, name) of each."""
    if name not in _made:
        info, between = gpu.types.GPUShaderCreateInfo(), gpu.types.GPUStageInterfaceInfo(name)
        between.smooth("VEC2", "at")
        for constant in constants:
            info.push_constant(*constant)
        info.sampler(0, "FLOAT_2D", "picture")
        info.vertex_in(0, "VEC2", "corner")
        info.vertex_out(between)
        info.fragment_out(0, "VEC4", "shown")
        info.vertex_source(vertex)
        info.fragment_source(fragment)
        shader = gpu.shader.create_from_info(info)
        _made[name] = shader, batch_for_shader(shader, "TRI_STRIP", {"corner": corners})
    return _made[name]


@contextmanager
def drawn_with(blend: str, depth_test: str):
    """Within it pictures are drawn with this blending and depth test, and no depth is written."""
    before = gpu.state.blend_get(), gpu.state.depth_test_get(), gpu.state.depth_mask_get()
    gpu.state.blend_set(blend)
    gpu.state.depth_test_set(depth_test)
    gpu.state.depth_mask_set(False)
    try:
        yield
    finally:
        gpu.state.blend_set(before[0])
        gpu.state.depth_test_set(before[1])
        gpu.state.depth_mask_set(before[2])


def texture_of(picture: RegionPicture):
    """A new texture that holds a picture; a texture cannot be written to again.

    It has four 32-bit floats, since Vulkan converts shorter ones slowly.
    """
    height, width = picture.rgba.shape[:2]
    buffer = gpu.types.Buffer("FLOAT", picture.rgba.shape, picture.rgba)
    return gpu.types.GPUTexture((width, height), format="RGBA32F", data=buffer)


def draw(placed: list, framebuffer) -> None:
    """Draw textures into the viewport, in their order, and keep what lies behind them out of the overlay.

    Parameters
    ----------
    placed : list of (gpu.types.GPUTexture, tuple)
        Textures, and where they lie as ``RegionPicture.place`` says.
    framebuffer : gpu.types.GPUFrameBuffer
        The viewport's own, of this redraw.
    """
    with framebuffer.bind():
        _draw_quads(placed, "ALPHA_PREMULT", 0.0)
    _draw_quads(placed, "MULTIPLY", 1.0)


def _draw_quads(placed: list, blend: str, veil: float) -> None:
    constants = ("VEC4", "place"), ("FLOAT", "veil")
    shader, quad = shader_and_quad("rle_splat_live", constants, VERTEX, FRAGMENT, CORNERS)
    with drawn_with(blend, "NONE"):
        for texture, (left, top, right, bottom) in placed:
            shader.bind()
            shader.uniform_float("place", (2 * left - 1, 1 - 2 * bottom, 2 * right - 1, 1 - 2 * top))
            shader.uniform_float("veil", veil)
            shader.uniform_sampler("picture", texture)
            quad.draw(shader)


def forget() -> None:
    """Release the shaders."""
    _made.clear()
