"""Draws slices in Solid shading as they are, without the viewport's light, and where other slices cross them.

In PRE_VIEW the framebuffer in use is the viewport's own, see ``drawing``.  The slices' pixels are drawn into it over
the meshes that Blender has shaded, where these are what is seen.
"""

import bpy
import gpu
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader
from mathutils import Vector

from ..loop import index
from . import drawing, slice_places, slices

VERTEX = """
void main()
{
  at = 0.5 * corner + 0.5;
  gl_Position = placing * vec4(corner, 0.0, 1.0);
  gl_Position.z -= nearer * gl_Position.w;
}
"""
FRAGMENT = """
void main()
{
  vec4 color = texture(picture, at);
  if (color.a < 0.1) {  // as Blender's Solid shading, whose pixels would show beside these
    discard;
  }
  shown = vec4(color.rgb / color.a, 1.0);  // premultiplied
}
"""
NEARER = 2e-5  # of the depth range: over the mesh of the slice itself, whose depth is rounded in another way
CORNERS = [slices.CORNERS[corner][:2] for corner in (0, 1, 3, 2)]  # of the quad
AXIS_COLORS = ((1.0, 0.2, 0.32, 1.0), (0.55, 0.86, 0.0, 1.0), (0.16, 0.56, 1.0, 1.0))  # of Blender's x, y and z

_framebuffer: list = []  # the viewport's own, during a redraw


def _has_slices() -> bool:
    return bool(index.of(bpy.context.scene).slices)


def _before() -> None:
    """PRE_VIEW: hold the viewport's framebuffer until its objects are drawn; not while a render writes the pictures."""
    _framebuffer.clear()
    shading = bpy.context.space_data.shading
    if _has_slices() and not bpy.app.is_job_running("RENDER") and shading.type == "SOLID" and not shading.show_xray:
        _framebuffer.append(gpu.state.active_framebuffer_get())


def _after() -> None:
    """POST_VIEW: draw the pictures of the slices that the viewport shows."""
    if not _framebuffer:
        return
    found = [one for one in slice_places.visible_slices(bpy.context) if one.rle_splat.slice_image is not None]
    with _framebuffer.pop().bind(), drawing.drawn_with("NONE", "LESS_EQUAL"):
        for one in found:
            _draw_picture(one, bpy.context.region_data.perspective_matrix)


def _draw_picture(one, view_matrix) -> None:
    constants = ("MAT4", "placing"), ("FLOAT", "nearer")
    shader, quad = drawing.shader_and_quad("rle_splat_slice", constants, VERTEX, FRAGMENT, CORNERS)
    shader.bind()
    shader.uniform_float("placing", view_matrix @ one.matrix_world)
    shader.uniform_float("nearer", NEARER)
    shader.uniform_sampler("picture", gpu.texture.from_image(one.rle_splat.slice_image))
    quad.draw(shader)


def _draw_crossings() -> None:
    """POST_PIXEL: in a quad view, lines where the other slices cross the one that a region is for."""
    context = bpy.context
    if not (_has_slices() and len(context.space_data.region_quadviews)):
        return
    faced = slice_places.faced_slice(context)
    if faced is None:
        return
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    for other in slice_places.visible_slices(context):
        ends = slice_places.crossing(faced, other) if other != faced and other.parent == faced.parent else None
        places = [location_3d_to_region_2d(context.region, context.region_data, end) for end in ends or ()]
        if not places or None in places:
            continue
        normal = other.matrix_world.to_3x3() @ Vector((0.0, 0.0, 1.0))
        shader.bind()
        shader.uniform_float("color", AXIS_COLORS[max(range(3), key=lambda axis, of=normal: abs(of[axis]))])
        batch_for_shader(shader, "LINES", {"pos": [(*place, 0.0) for place in places]}).draw(shader)


HANDLERS = drawing.Handlers((_before, "PRE_VIEW"), (_after, "POST_VIEW"), (_draw_crossings, "POST_PIXEL"))
