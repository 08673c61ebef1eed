"""The scripting interface, one name a line, by task as docs/reference/python.md has it: for ``__init__.py``, type
checkers and editors.
"""

# read and write
from .read.formats import read_volume as read_volume
from .read.formats import read_steps as read_steps
from .read.formats import list_series as list_series
from .read.dicom.titles import SeriesInfo as SeriesInfo
from .read.labels import read_labels as read_labels
from .read.channels import read_channel as read_channel
from .read.images import read_sitk as read_sitk
from .read.images import read_nibabel as read_nibabel
from .read.formats import write_volume as write_volume
from .read.formats import write_steps as write_steps
from .volume.volume import Volume as Volume
from .volume.volume import NamedLabel as NamedLabel

# transfer functions
from .classify.presets import fit_preset as fit_preset
from .classify.presets import preset as preset
from .classify.presets import preset_names as preset_names
from .classify.default import default_transfer_function as default_transfer_function
from .classify.transfer_files import read_transfer_functions as read_transfer_functions
from .classify.transfer_files import fit_function as fit_function
from .classify.transfer_function import TransferFunction as TransferFunction
from .classify.transfer_function import Shade as Shade
from .classify.transfer_function import GradientOpacity as GradientOpacity
from .classify.foreign import FileFunction as FileFunction

# scene
from .scene import Scene as Scene
from .view.turntable import turntable as turntable
from .view.turntable import turntable_aim as turntable_aim
from .view.look_at import look_at as look_at
from .scene import Camera as Camera
from .scene import Light as Light
from .shade.light_recipes import add_lights as add_lights
from .cli.images import read_environment as read_environment
from .scene import Environment as Environment
from .scene import Mist as Mist
from .scene import Clip as Clip
from .scene import Labels as Labels
from .classify.label_styles import style_labels as style_labels
from .classify.label_styles import LabelStyle as LabelStyle
from .segment.body import body_labels as body_labels
from .scene import Channel as Channel
from .scene import Pose as Pose
from .scene.color import decode_srgb as decode_srgb

# pictures
from .pipeline.render import render as render
from .pipeline.render import render_steps as render_steps
from .accuracy.planner.tolerance import render_within as render_within
from .accuracy.planner.tolerance import render_within_steps as render_within_steps
from .scene import Quality as Quality
from .scene import Rendering as Rendering
from .cli.images import write_picture as write_picture
from .pipeline.stage_cache import StageCache as StageCache
from .runtime.steps import Progress as Progress
from .scene import Cancelled as Cancelled
from .scene import RleSplatError as RleSplatError

# figures
from .figure.make import make_figure as make_figure
from .cli.figure_files import write_figure as write_figure
from .figure.plan import FigureStyle as FigureStyle
from .figure.make import MadeFigure as MadeFigure

# encoded volumes
from .pipeline.encode_scene import encode as encode
from .pipeline.encode_scene import encode_steps as encode_steps
from .pipeline.encode_folder import encode_folder as encode_folder
from .encode.store import read_encoded as read_encoded
from .encode.store import write_encoded as write_encoded
from .encode.stored import StoredVolume as StoredVolume
from .pipeline.quick_estimate import estimate_memory as estimate_memory
from .pipeline.memory_estimate import MemoryEstimate as MemoryEstimate

# release
__version__: str
