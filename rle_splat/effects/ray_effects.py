"""The effects on a picture's rays: the one interface by which clipping, meshes, clip objects and glass attach.

An effect on rays is a RayEffect: it gives the ray intervals of a base plane, whether the planes are drawn more than
once, how the pictures of these passes are mixed, and how the finished picture is tinted.  ``RAY_EFFECTS`` lists them in
the order in which they shorten rays; a new one is a module with a subclass and a row there.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ..runtime.steps import Clock
from ..scene import NO_DEPTH, Quality, Scene
from ..splat.intermediate_image import IntermediateImage
from ..view.base_plane import BasePlane
from ..view.eye import IndexView
from ..warp.warp import warp_reach
from .analyze import EffectSet
from .camera_clip import CameraClip
from .clips import ClipBodies
from .glass import Glass
from .mesh_occlusion import MeshSurfaces
from .ray_pass import RayEffect, RayPass

RAY_EFFECTS: tuple[Callable, ...] = (CameraClip.of, MeshSurfaces.of, ClipBodies.of, Glass.of)


class RayEffects:
    """The effects on rays that a picture has.

    Parameters
    ----------
    scene : Scene
        Without the effects that are off, its volume on the grid that is splatted.
    """

    def __init__(self, scene: Scene, view: IndexView, quality: Quality, effects: EffectSet, clock: Clock):
        self.effects, self._scene, self._clock = effects, scene, clock
        self._reach = warp_reach(quality)
        made = (make(scene, view, quality) for make in RAY_EFFECTS)
        self._chain: list[RayEffect] = [effect for effect in made if effect is not None]

    @property
    def shorten_rays(self) -> bool:
        """Whether any rays may be shortened; known before ``leave_out_idle_steps``."""
        return any(effect.shortens_rays for effect in self._chain)

    def leave_out_idle_steps(self, planes: list[BasePlane]):
        """Generator of fractions done: drop the effects that do nothing to the rays of some base planes."""
        left = []
        for effect in self._chain:
            with self._clock.stage(effect.stage):
                idle = yield from effect.inspect_steps(planes)
            if idle is None:
                left.append(effect)
            elif effect.name is not None:
                self.effects = self.effects.turn_off(effect.name, idle)
        self._chain = left

    def passes(self, planes: list[BasePlane]) -> list[RayPass]:
        """The passes over the base planes: usually one; meshes with silhouettes add another."""
        passes = [RayPass(self._scene.region, list(enumerate(planes)))]
        for effect in self._chain:
            passes = effect.passes(passes, self._reach)
        return passes

    def intervals(self, ray_pass: RayPass, number: int, plane: BasePlane):
        """The part of a base plane that has rays, and their intervals, or None; see ``RayEffect.shorten``."""
        found = plane, None
        for effect in self._chain:
            with self._clock.stage(effect.stage_of(ray_pass)):
                found = effect.shorten(ray_pass, number, *found)
            if found is None:
                return None
        return found

    def complete(self, ray_pass: RayPass, number: int, image: IntermediateImage) -> IntermediateImage:
        """The intermediate image of a plane, completed in place by the effects; see ``RayEffect.complete``."""
        for effect in self._chain:
            with self._clock.stage(effect.stage):
                effect.complete(ray_pass, number, image)
        return image

    def mix(self, ray_pass: RayPass, picture, found):
        """The picture with the result of a further pass.

        Parameters
        ----------
        picture : (rgba, depth) or None
            The picture so far; None before the first pass.
        found : (rgba, depth)
            The result of the pass.

        Returns
        -------
        rgba : (H, W, 4) ndarray of float32
            Premultiplied, scene-linear.
        depth : (H, W) ndarray of float32
            Planar depth in world units.
        """
        if picture is None:
            return found
        for effect in self._chain:
            picture = effect.mix(ray_pass, picture, found)
        return picture

    def trace(self, trace, columns, rows):
        """Trace single rays through pixels of the picture, to the meshes in it.

        Parameters
        ----------
        trace : callable
            ``trace(columns, rows, ends)``, as ``RayEffect.trace`` has it.
        columns, rows : (n,) ndarray of int
            From the left and the top of the picture.

        Returns
        -------
        rgba, depth, work : as ``trace`` returns them
        """
        for effect in self._chain:
            trace = partial(effect.trace, trace)
        return trace(columns, rows)

    def clamp_to_clip(self, depth: np.ndarray) -> np.ndarray:
        """Clamp depths to the camera's clip distances where rays were shortened.

        A pixel's depth is that of the nearest sheet pixel's ray, which meets the clip planes elsewhere.

        Parameters
        ----------
        depth : (H, W) ndarray of float32
            Planar depth in world units; changed in place.

        Returns
        -------
        (H, W) ndarray of float32
        """
        if not any(effect.moves_depth for effect in self._chain):
            return depth
        camera, largest, none = self._scene.camera, float(np.finfo(np.float32).max), np.float32(NO_DEPTH)
        missing = depth == none
        np.clip(depth, min(camera.clip_start, largest), min(camera.clip_end, largest), out=depth)
        np.copyto(depth, none, where=missing)
        return depth

    def tint(self, rgba: np.ndarray, depth: np.ndarray, corner: tuple[int, int]) -> np.ndarray:
        """A picture as it is seen through the scene's glass, if there is any; see ``RayEffect.tint``."""
        for effect in self._chain:
            with self._clock.stage(effect.stage):
                rgba = effect.tint(rgba, depth, corner)
        return rgba

    def remarks(self, picture, some_visible: bool) -> list[str]:
        """Sentences for the report on a finished picture.

        Parameters
        ----------
        picture : (rgba, depth)
        some_visible : bool
            Whether the volume has any visible voxel.
        """
        sentences = [effect.nothing_left for effect in self._chain if effect.nothing_left]
        return sentences if sentences and some_visible and not picture[0][..., 3].any() else []
