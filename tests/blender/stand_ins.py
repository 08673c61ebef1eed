"""Stand-ins for what a viewport needs: a clock, matrices, contents and depths of the test's own."""

from types import SimpleNamespace

import numpy as np

SIZE = 48, 40
SIDE = 8  # voxels


class Clock:
    """A clock that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Surface:
    """Stands in for Blender: contents, and depths as of the test."""

    def __init__(self, contents):
        self.held, self.depth, self.hiding, self.reads, self.with_triangles = contents, None, True, 0, []

    def hides(self):
        return self.hiding

    def contents(self, request, with_triangles):
        self.with_triangles.append(with_triangles)
        return dict(zip(request.volumes, self.held, strict=True))

    def ends(self, view, _part):
        return None if self.depth is None else np.full((view.height, view.width), self.depth, np.float32)


def modules_of(bridge):
    """The modules of viewports."""
    return SimpleNamespace(**{name: bridge(f"live.{name}") for name in ("view", "frames", "viewport")})


def contents_of(live, core):
    """One volume of one color, about the origin."""
    volume = core("volume.volume").Volume(np.full((SIDE,) * 3, 100, np.uint8), np.eye(4))
    transfer = core("classify.transfer_function").TransferFunction(
        opacity=((0.0, 0.2), (255.0, 0.2)), color=((0.0, 0.8, 0.4, 0.2), (255.0, 0.8, 0.4, 0.2)), shade=None
    )
    scene = core("scene")
    placed = np.eye(4)
    placed[:3, 3] = -0.5 * (SIDE - 1)
    plain = scene.Scene(volume, transfer, scene.Camera(), 1, 1, placed, headlight=False)
    half = 0.5 * SIDE
    corners = np.array([(x, y, z) for x in (-half, half) for y in (-half, half) for z in (-half, half)])
    return live.frames.Contents(plain, scene.Quality(), "first", corners)


def request_of(live, distance=30.0, volumes=("one",), **more):
    """A view along -Z from a distance."""
    view = np.eye(4)
    view[2, 3] = -distance
    window = np.diag((2.0, 2.4, -1.002, 0.0))
    window[2, 3], window[3, 2] = -0.2002, -1.0
    matrices = live.view.Matrices(tuple(view.ravel()), tuple(window.ravel()), *SIZE, clip=(0.1, 100.0))
    return live.viewport.Request(matrices, volumes, **more)


def make(live, contents, core):
    """A viewport with its clock and its surface."""
    clock = Clock()
    viewport = live.viewport.Viewport(core("pipeline.stage_cache").StageCache(), clock)
    return viewport, clock, Surface([contents])


def finish(viewport, clock):
    """Let a timer work until there is nothing left to do."""
    for _ in range(200):
        if not viewport.is_busy:
            return
        clock.now += viewport.wait()
        viewport.work()
    raise AssertionError("the work does not end")
