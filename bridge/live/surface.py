"""What a viewport looks up while it is redrawn: its matrices, the contents of its volumes and its depth."""

from dataclasses import replace
from time import perf_counter

import bpy
import gpu
import numpy as np

from ...rle_splat.scene import Camera, RleSplatError
from ...rle_splat.view.box_order import box_of
from ..data import preferences, settings
from ..data.decimals import typed_tuple
from ..loop import work
from ..messages import sentence_of
from ..pictures import outdated
from ..scene import render_scene
from ..scene.lights import is_any_lit
from ..scene.meshes import has_glass
from ..volumes import encoded
from . import shown
from .frames import Contents
from .view import Matrices, ViewportView, ray_ends
from .viewport import Habits, Request

BEYOND = 2.0  # voxels by which footprints reach beyond the outermost voxel centers
ELSEWHERE = {"depth of field", "motion blur"}  # effects of a camera's exposure, which a viewport has not
WAITS, MOST_WAITS = 0.25, 3  # seconds that reading depth may take, and how often in a row it may take longer
_ANY_VIEW = Camera(), 1, 1


def request_of(context, volumes: tuple) -> Request:
    """What the viewport shows whose draw handler runs; ``volumes`` are those of ``shown.visible_volumes``."""
    space, region, view = context.space_data, context.region, context.region_data
    shading = space.shading
    drawn = (
        shading.type, context.scene.render.engine, space.overlay.show_overlays, shading.show_xray,
        shading.show_xray_wireframe,
    )  # fmt: skip
    overlay = space.overlay
    has_floor = overlay.show_overlays and (overlay.show_floor or overlay.show_axis_x or overlay.show_axis_y)
    return Request(matrices_of(context, space, region, view), volumes, drawn, preferred_habits(), has_floor)


def preferred_habits() -> Habits:
    """What the user wants of views that are still, and of drafts."""
    return Habits(preferences.value("refine_live"), int(preferences.value("live_pixels") == "HALF"))


def matrices_of(context, space, region, view) -> Matrices:
    """The view of a region; ``view``: its bpy.types.RegionView3D."""
    both = (tuple(value for row in matrix for value in row) for matrix in (view.view_matrix, view.window_matrix))
    return Matrices(*both, region.width, region.height, clip_of(context, space, view))


def clip_of(context, space, view) -> tuple:
    """Clip distances of a viewport, which are those of the camera that it looks through.

    In world units ahead of the view's origin; of no meaning for an orthographic view through no camera.
    """
    owner = space
    if view.view_perspective == "CAMERA":
        camera = space.camera if space.use_local_camera else context.scene.camera
        if camera is not None and camera.type == "CAMERA":
            owner = camera.data
    return typed_tuple((owner.clip_start, owner.clip_end))


def has_depth(request: Request) -> bool:
    """Whether a viewport's framebuffer holds the depth of its objects.

    Without overlays EEVEE leaves zeros in it while it samples, and Cycles ones.
    """
    shading, engine, overlays = request.drawn[:3]
    return overlays or shading in ("SOLID", "WIREFRAME") or (shading == "RENDERED" and engine == "BLENDER_WORKBENCH")


class BlenderSurface:
    """The ``Surface`` of a viewport during one redraw.

    Parameters
    ----------
    context : bpy.types.Context
        While a draw handler runs.
    framebuffer : gpu.types.GPUFrameBuffer or None
        The viewport's own, with the depth of its objects.
    waits : list of float
        How long the last reads of depth took, in seconds; changed in place.
    """

    def __init__(self, context, request: Request, framebuffer, waits: list):
        self._scene, self._depsgraph = context.scene, context.view_layer.depsgraph
        self._request, self._framebuffer, self._waits = request, framebuffer, waits

    def hides(self) -> bool:
        """See ``Surface.hides``."""
        return self._scene.rle_splat.meshes_occlude

    def contents(self, request: Request, with_triangles: bool) -> dict[str, Contents | str | None]:
        """See ``Surface.contents``."""
        if self._depsgraph is None:
            return dict.fromkeys(request.volumes)
        owners = {key: owner for key in request.volumes if (owner := shown.find(key)) is not None}
        late = work.late(self._depsgraph)
        read = {key: owner for key, owner in owners.items() if not work.want(owner, self._depsgraph, late)}
        surfaces = {}
        if read and self.hides() and (with_triangles or self._casts_shadows()):
            surfaces = render_scene.read_occluders(self._depsgraph)
            if not with_triangles:  # rays end at the depth of glass, too
                surfaces = {"triangles": surfaces["triangles"]}
        return {
            key: self._contents_or_problem(owner, shown.matrix_of(key), late, surfaces) if key in read else None
            for key, owner in owners.items()
        }

    def _casts_shadows(self) -> bool:
        """Whether meshes count beside the depth at which they end rays."""
        held = self._scene.rle_splat
        return (held.use_shadows and is_any_lit(self._scene)) or held.ambient_occlusion > 0.0

    def _contents_or_problem(self, owner, matrix, late: int, surfaces: dict) -> Contents | str:
        """Of a volume that cannot be shown a sentence, so that the others are shown."""
        try:
            return self._contents_of(owner, matrix, late, surfaces)
        except RleSplatError as problem:
            return sentence_of(problem)

    def _contents_of(self, owner, matrix, late: int, surfaces: dict) -> Contents:
        if matrix is None:
            render_scene.check_kept_up(owner, self._depsgraph)
        plain = render_scene.seen_by(owner, self._depsgraph, _ANY_VIEW, matrix=matrix, ahead=late, **surfaces)
        overrides = {name: on for name, on in plain.effects.items() if not (on and name in ELSEWHERE)}
        if overrides != plain.effects:
            plain = replace(plain, effects=overrides)
        quality = encoded.suited(settings.quality_of(self._depsgraph.scene_eval), plain.volume)
        digest = outdated.made_of(plain, quality, None, plain.triangles is not None).digest
        return Contents(plain, quality, digest, box_of(plain.index_to_world, plain.volume.shape_xyz, BEYOND))

    def ends(self, view: ViewportView, part) -> np.ndarray | None:
        """See ``Surface.ends``."""
        if self._framebuffer is None or not has_depth(self._request):
            return None
        if len(self._waits) == MOST_WAITS and min(self._waits) > WAITS:
            self._waits.pop()  # the viewport asks again later, when one read decides
            return None
        if self._request.drawn[0] in ("MATERIAL", "RENDERED") and has_glass(self._depsgraph):
            return None  # the depth is that of the glass: triangles end rays
        left, top, right, bottom = part
        _, _, width, height = self._framebuffer.viewport_get()
        if (width, height) != (view.width, view.height):
            return None
        buffer = np.empty((bottom - top, right - left), np.float32)
        held = gpu.types.Buffer("FLOAT", buffer.shape, buffer)  # copies nothing: the driver writes into the array
        began = perf_counter()
        try:
            self._framebuffer.read_depth(left, view.height - bottom, right - left, bottom - top, data=held)
        except (RuntimeError, ValueError, SystemError):
            return None  # a driver that cannot: triangles end rays
        self._waits[:] = [*self._waits, perf_counter() - began][-MOST_WAITS:]
        if not buffer.any():  # nothing has been drawn into it
            return None
        return ray_ends(view, buffer, part)


def region_of(address: int) -> tuple:
    """The region of a 3D view at an address, its area and its window; None for each if it was closed."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.as_pointer() == address:
                        return region, area, window
    return None, None, None
