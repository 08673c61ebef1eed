"""The interface of a system: its description, and the functions prepare and draw."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..scene import NO_DEPTH, Quality, Rendering
from .medium import ShadedScene


@dataclass(frozen=True, eq=False)
class ReadySystem:
    """A system after the work that does not depend on the frame.

    Attributes
    ----------
    draw : callable
        () -> Rendering of one frame.
    memory_bytes : dict
        Bytes, by name, of the data that a frame is drawn from.
    notes : dict
        JSON-ready facts of this system alone.
    """

    draw: Callable[[], Rendering]
    memory_bytes: dict
    notes: dict = field(default_factory=dict)

    @property
    def total_bytes(self) -> int:
        """The sum of ``memory_bytes``."""
        return sum(self.memory_bytes.values())


@dataclass(frozen=True)
class System:
    """One entry of the table of systems.

    Attributes
    ----------
    reference : str
        The publication, with its number in the paper where the paper cites it.
    differs : str
        Its differences from our renderer and from the original, in words.
    prepare : callable
        (ShadedScene, Quality) -> ReadySystem.
    channels : str
        The channels of its picture that are compared with T1: "rgba", or "a" for a system without occlusion.
    """

    name: str
    title: str
    reference: str
    differs: str
    prepare: Callable[[ShadedScene, Quality], ReadySystem]
    channels: str = "rgba"


def picture(transmittance_image: np.ndarray, depth: np.ndarray | None = None, **report) -> Rendering:
    """A Rendering from premultiplied color and *transmittance* (H, W, 4); without depth where none is given."""
    rgba = np.ascontiguousarray(transmittance_image, dtype=np.float32)
    rgba[..., 3] = 1.0 - rgba[..., 3]
    if depth is None:
        depth = np.full(rgba.shape[:2], NO_DEPTH, np.float32)
    return Rendering(rgba, depth, report)
