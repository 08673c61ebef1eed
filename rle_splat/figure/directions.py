"""Where the patient's sides are in a picture: letters at its edges, a cube, and the name of the view."""

import numpy as np

from ..scene import Scene
from ..view.projection import world_to_camera
from ..volume.orientation import LETTERS, letters_of
from ..volume.volume import PATIENT
from .page import Fill, Stroke, Text

NO_BREAK = "\u00a0"  # a space at which no line ends
SAME_VIEW = np.cos(np.radians(1.0))  # views that differ by less have the same name
VIEWS = {
    "A": "Anterior view", "P": "Posterior view", "L": "Left lateral view", "R": "Right lateral view",
    "S": "Superior view", "I": "Inferior view",
}  # fmt: skip
WORDS = {"R": "right", "L": "left", "A": "anterior", "P": "posterior", "S": "superior", "I": "inferior"}
SHADES = (0.9, 0.78, 0.66)  # scene-linear gray of the cube's faces of each axis of the patient
LINE = 0.15  # mm
EDGE_ON = 0.02  # of a face's own area: a face that is not seen
LEAST_FACE = 0.35  # of a face's own area: a face that is seen so foreshortened has no letter


def knows_sides(scene: Scene) -> bool:
    """Whether the volume's file says where the patient's sides are."""
    return scene.volume.space == PATIENT


def patient_axes(scene: Scene) -> np.ndarray:
    """(3, 3) float64: unit vectors to the right, up and to the viewer of a picture, as rows, in LPS."""
    ways = world_to_camera(scene.camera)[:3, :3]
    own = np.linalg.solve(scene.volume_matrix[:3, :3], ways.T).T
    return own / np.linalg.norm(own, axis=1, keepdims=True)


def edge_letters(scene: Scene) -> dict[str, str]:
    """Letters for the edges of a picture: "left", "right", "top" and "bottom"."""
    right, up, _ = patient_axes(scene)
    found = {"left": -right, "right": right, "top": up, "bottom": -up}
    return {edge: letters_of(direction) for edge, direction in found.items()}


def view_name(scene: Scene) -> str:
    """The radiologists' name of a view, such as "Left anterior oblique 45°, cranial 20°"; "" where sides are unknown.

    It says where the viewer is, as for the detector in angiography; the degrees of an oblique begin at front or back.
    """
    if not knows_sides(scene):
        return ""
    viewer = patient_axes(scene)[2]
    if np.abs(viewer[2]) >= SAME_VIEW:
        return VIEWS[letters_of(viewer)[0]]
    turn = np.rint(np.degrees(np.arctan2(abs(viewer[0]), abs(viewer[1]))))
    tilt = np.rint(np.degrees(np.arcsin(np.clip(viewer[2], -1.0, 1.0))))
    side, face = (LETTERS[axis][int(viewer[axis] > 0.0)] for axis in (0, 1))
    oblique = f"{WORDS[side]} {WORDS[face]} oblique {turn:.0f}°".capitalize()
    name = {0.0: VIEWS[face], 90.0: VIEWS[side]}.get(turn, oblique)
    return name + (f", {'cranial' if tilt > 0.0 else 'caudal'}{NO_BREAK}{abs(tilt):.0f}°" if tilt else "")


def letter_texts(letters: dict, x: float, y: float, width: float, height: float, size: float, ink, halo) -> list:
    """Letters within the edges of a picture whose corner is (x, y); lengths in mm."""
    half = 0.36 * size  # half the height of a capital
    places = {
        "left": (x + 0.3 * size, y + 0.5 * height + half, "start"),
        "right": (x + width - 0.3 * size, y + 0.5 * height + half, "end"),
        "top": (x + 0.5 * width, y + 0.3 * size + 2.0 * half, "middle"),
        "bottom": (x + 0.5 * width, y + height - 0.3 * size, "middle"),
    }
    return [Text(*places[edge][:2], letters[edge], size, ink, anchor=places[edge][2], halo=halo) for edge in places]


def cube(scene: Scene, x: float, y: float, side: float, size: float) -> list:
    """A cube with the letters of the patient's sides, as the view sees it from afar.

    Parameters
    ----------
    x, y : float
        Its middle, mm.
    side : float
        Length of an edge, mm.
    size : float
        Font size, mm.

    Returns
    -------
    list
        Fill, Stroke and Text.
    """
    ways = world_to_camera(scene.camera)[:3, :3] @ scene.volume_matrix[:3, :3]
    ways = ways / np.linalg.norm(ways, axis=0)  # columns: the patient's axes, to the right, up and to the viewer
    items = []
    for axis in range(3):
        if abs(ways[2, axis]) < EDGE_ON:
            continue
        sign = 1.0 if ways[2, axis] > 0.0 else -1.0
        one, other = (ways[:, n] for n in range(3) if n != axis)
        face = sign * ways[:, axis]
        corners = [face + a * one + b * other for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        placed = tuple((x + 0.5 * side * c[0], y - 0.5 * side * c[1]) for c in corners)
        items += [Fill(placed, (SHADES[axis],) * 3), Stroke((*placed, placed[0]), LINE, (0.0, 0.0, 0.0))]
        if abs(ways[2, axis]) >= LEAST_FACE:
            middle = x + 0.5 * side * face[0], y - 0.5 * side * face[1] + 0.36 * size
            items.append(Text(*middle, LETTERS[axis][int(sign > 0.0)], size, (0.0, 0.0, 0.0), anchor="middle"))
    return items
