"""Plain data that describes a scene and its picture: scene, camera, lights, quality, rendering.

Nothing here renders and nothing here imports Blender. Every class is frozen, and arrays are treated as read-only.
Matrices are (4, 4) float64 for column vectors: ``matrix @ (x, y, z, 1)``.
"""

from .camera import SENSOR_FITS, Camera
from .checks import (
    BACKGROUNDS,
    LARGEST_LENGTH,
    LEAST_LENGTH,
    Background,
    as_background,
    as_color,
    as_float,
    as_matrix,
    from_mapping,
    read_json,
)
from .clip import CLIP_KINDS, Clip
from .environment import Environment
from .errors import Cancelled, RleSplatError, TooLargeError
from .further_volumes import Channel, Labels
from .light import LIGHT_TYPES, Light
from .mist import MIST_FALLOFFS, Mist
from .quality import (
    CLASSIFICATIONS,
    DEFAULT_CLASSIFICATION,
    DEFAULT_QUALITY,
    DEPTH_RULES,
    FOOTPRINTS,
    KNOB_TEXTS,
    MINIFICATIONS,
    MODELS,
    MOST_FADE,
    MOST_SHEET_DENSITY,
    NAMED_DEPTH_RULES,
    NO_RAYS,
    POST_ONLY,
    PRESET_AIMS,
    PRESET_KNOBS,
    QUALITY_PRESETS,
    RECORDS,
    REMOVED_BACKEND,
    REMOVED_VALUES,
    SCALAR_DEPTH_RULES,
    WARP_FILTERS,
    Classification,
    Quality,
    QualityName,
    as_quality,
    midpoints_of,
    not_in_post,
    preintegrated_of,
    preset_knobs,
    truth_of,
    without_removed,
)
from .scene import MODE_TEXTS, MODES, NO_DEPTH, Pose, Rendering, Scene, check_crop
