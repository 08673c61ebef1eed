"""Figures in Blender: the view of a viewport, where the data is, and the files."""

import os
from dataclasses import replace

import bpy
import numpy as np

from ...rle_splat.classify.presets import fit_preset
from ...rle_splat.figure.files import CONTENTS, PageCanvas, check_suffix, sidecar_path
from ...rle_splat.figure.make import MadeFigure
from ...rle_splat.figure.plan import Figure, FigureStyle, Panel, tile_size
from ...rle_splat.figure.sidecar import sidecar_of
from ...rle_splat.figure.sources import DataSource, Sources
from ...rle_splat.runtime.outputs import check_outputs, write_report
from ...rle_splat.runtime.whole_files import whole_files
from ...rle_splat.scene import Camera, RleSplatError, Scene
from ..data.playback import shown_frame
from ..live.surface import matrices_of
from ..live.view import view_of
from ..scene import viewports
from ..translations import filled
from ..volumes import box, channels, labels, volumes
from ..volumes.source_paths import check_is_no_scan
from . import images

EXR = ".exr"
NO_VIEWPORT = "There is no 3D viewport to take the view from; choose the scene's camera."


def viewport_camera(context, volume_object) -> tuple[Camera, int, int]:
    """The view of the 3D viewport in use, else of the largest one, as a camera.

    Parameters
    ----------
    volume_object : bpy.types.Object
        Which is to be seen; an orthographic viewport also shows what is behind its origin.

    Returns
    -------
    width, height : int
        Pixels of the viewport.

    Raises
    ------
    RleSplatError
        Without a 3D viewport, or for one that shows nothing.
    """
    areas = viewports.areas_of(context.window)
    if not areas:
        raise RleSplatError(NO_VIEWPORT)
    area = context.area if context.area in areas else max(areas, key=lambda one: one.width * one.height)
    space = area.spaces.active
    view = space.region_3d
    region = next(one for one in area.regions if one.type == "WINDOW")
    corners = box.world_corners(volume_object)
    ahead = -(np.column_stack((corners, np.ones(len(corners)))) @ np.array(view.view_matrix, np.float64).T)[:, 2]
    nearest = float(ahead.min()) if len(corners) else -np.inf  # somebody may have removed the box
    found = view_of(matrices_of(context, space, region, view), nearest)
    return replace(found.camera, pixel_aspect=(1.0, 1.0)), region.width, region.height


def compared(plain: Scene, presets, volume_object, depsgraph) -> tuple[Panel, ...]:
    """A panel for each preset; labels that change the volume's transfer function change that of the preset."""
    volume, panels = plain.volume, []
    for name in presets:
        function = fit_preset(name, volume)[0]
        shown = labels.read_labels(volume_object, depsgraph, volume, function)
        panels.append(Panel(replace(plain, transfer_function=function, labels=shown), function.name))
    return tuple(panels)


def figure_of(panels: tuple[Panel, ...], style: FigureStyle) -> Figure:
    """A figure of panels whose scenes give the aspect of its pictures by their width and height in pixels."""
    plain = panels[0].scene
    style = replace(style, aspect=plain.width / plain.height)
    width, height = tile_size(style, len(panels))
    return Figure(tuple(replace(one, scene=replace(one.scene, width=width, height=height)) for one in panels), style)


def is_free(path: str) -> bool:
    """Whether neither a figure nor its sidecar is there."""
    return not os.path.exists(path) and not sidecar_path(path).exists()


def check_files(path: str, was_typed: bool) -> None:
    """Refuse a path that no figure can be written to.

    ``was_typed``: whether a user chose the path in a dialog, which shows that a figure is there but not its sidecar.
    """
    check_suffix(path, (EXR,))
    check_is_no_scan(path)
    check_outputs([path, sidecar_path(path)])
    if was_typed and not os.path.exists(path) and not is_free(path):
        raise RleSplatError(filled("{path} belongs to another figure; give another name.", path=sidecar_path(path)))


def sources_of(volume_object, depsgraph, path: str) -> Sources:
    """Where the data of a volume object is, its labels and channels among it, as seen from the folder of a figure."""
    folder = os.path.dirname(os.path.abspath(path))

    def seen(file, options) -> DataSource:
        try:
            name = os.path.relpath(file, folder)
        except ValueError:  # on Windows there is no relative path to another drive
            name = os.path.basename(file)
        return DataSource(name.replace(os.sep, "/"), options)

    read = [
        volumes.source_of(one, shown_frame(one, depsgraph))
        for one in (volume_object, *channels.sources_of(volume_object, depsgraph))
    ]
    volume, *further = (seen(one.path, one.options) for one in read)
    used = labels.are_used(volume_object)
    return Sources(volume, seen(labels.file_of(volume_object).path, {}) if used else None, tuple(further))


def write(path: str, made: MadeFigure, sources: Sources) -> dict:
    """Write a figure and its sidecar.

    Parameters
    ----------
    path : str
        Absolute path with the suffix .svg, .png or .exr.

    Raises
    ------
    RleSplatError, OSError
        If a file cannot be written; both are whole then, or as they were.
    """
    suffix, canvas = check_suffix(path, (EXR,)), PageCanvas(made.page)
    sidecar = sidecar_of(made, sources)
    with whole_files([path, sidecar_path(path)]) as parts:
        if suffix == EXR:
            images.save_exr(canvas(), str(parts[0]))
        else:
            parts[0].write_bytes(CONTENTS[suffix](made.page, canvas))
        write_report(parts[1], sidecar)
    return sidecar


def absolute(path: str) -> str:
    """A path of Blender's, such as one relative to the .blend, as an absolute path."""
    return os.path.abspath(bpy.path.abspath(path))
