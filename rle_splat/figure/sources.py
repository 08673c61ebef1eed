"""The data of a figure: its volume, labels and channels, and where a sidecar says that their files are."""

from dataclasses import dataclass, field

from ..classify.transfer_function import TransferFunction
from ..scene import Channel, Labels, RleSplatError, Scene
from ..scene.plain import plain
from ..volume.volume import Volume

FURTHER = ("labels", "channels")  # fields of a scene that have files of their own


@dataclass(frozen=True)
class DataSource:
    """Where data of a figure is: the file as the user gave it, and the options of ``read_volume``.

    ``hash`` is the ``Volume.key`` that a sidecar tells, of the data as it was brought onto the volume's grid.
    """

    file: str
    options: dict = field(default_factory=dict)
    hash: str = ""


@dataclass(frozen=True)
class Sources:
    """Where a figure's volume, its labels and its channels are."""

    volume: DataSource
    labels: DataSource | None = None
    channels: tuple[DataSource, ...] = ()


@dataclass(frozen=True, eq=False)
class FigureData:
    """A figure's volume, and the labels and channels on its grid."""

    volume: Volume
    labels: Volume | None = None
    channels: tuple[Volume, ...] = ()


# --- where the files are ----------------------------------------------------------------------------------------------


def sources_json(sources: Sources, scene: Scene) -> dict:
    """The entries of a sidecar that tell where its files are; ``scene``: of any of its panels."""
    volume = scene.volume
    about = {
        "shape_xyz": plain(volume.shape_xyz), "affine": volume.affine.tolist(), "unit": volume.unit,
        "value_unit": volume.value_unit,
    }  # fmt: skip
    return {
        "data": {**_entry(sources.volume, volume), **about},
        "labels": None if scene.labels is None else _entry(sources.labels, scene.labels.volume),
        "channels": [
            _entry(source, one.volume) for source, one in zip(sources.channels, scene.channels, strict=True)
        ],
    }  # fmt: skip


def _entry(source: DataSource, volume: Volume) -> dict:
    return {"file": source.file, "options": plain(source.options), "hash": volume.key}


def sources_of(content: dict, path) -> Sources:
    """Where the files of the sidecar ``path`` are; it may be of an earlier version, without labels and channels.

    Raises
    ------
    RleSplatError
        If an entry is not as it was written.
    """
    labels = None if content.get("labels") is None else _source(part(content, "labels", dict, path), path)
    channels = part(content, "channels", list, path) if "channels" in content else []
    if not all(isinstance(one, dict) for one in channels):
        raise RleSplatError(f"A channel of the sidecar {path} is not an object; use the file as it was written.")
    volume = _source(part(content, "data", dict, path), path)
    return Sources(volume, labels, tuple(_source(one, path) for one in channels))


def _source(entry: dict, path) -> DataSource:
    options = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in part(entry, "options", dict, path).items()
    }
    return DataSource(part(entry, "file", str, path), options, part(entry, "hash", str, path))


def part(mapping: dict, name: str, kind: type, path):
    """An entry of the sidecar ``path`` of a type; RleSplatError for one that is missing or of another."""
    if not isinstance(mapping.get(name), kind):
        raise RleSplatError(f"The sidecar {path} has no valid {name!r}; use the file as it was written.")
    return mapping[name]


def check_data(source: DataSource, volume: Volume, path) -> None:
    """Refuse data, read from ``path``, that is not what a figure was made of."""
    if volume.key != source.hash:
        raise RleSplatError(
            f"The data of {path} is not what the figure was made of (its hash is {volume.key}, not {source.hash}); "
            "give the original file."
        )


# --- how a panel shows them -------------------------------------------------------------------------------------------


def further_json(scene: Scene) -> dict:
    """How a panel shows labels and channels. Names of labels are left out: no bit depends on them."""
    labels = scene.labels
    return {
        "labels": None if labels is None else {
            "functions": [
                {"label": int(label), "transfer_function": None if function is None else function.to_json()}
                for label, function in labels.functions.items()
            ],
            "smooth": labels.smooth,
        },
        "channels": [one.transfer_function.to_json() for one in scene.channels],
    }  # fmt: skip


def further_of(given: dict, data: FigureData) -> dict:
    """The labels and channels of a Scene from the scene of a sidecar's panel.

    Raises
    ------
    RleSplatError
        If the panel shows other files than the sidecar names.
    TypeError, KeyError
        If an entry is not as it was written.
    """
    labels, functions = given.get("labels"), given.get("channels", [])
    if (labels is None) != (data.labels is None) or len(functions) != len(data.channels):
        raise RleSplatError(
            "A panel of the sidecar has other labels or channels than the sidecar has files; use the file as written."
        )
    return {
        "labels": None if labels is None else _labels(labels, data.labels),
        "channels": tuple(
            Channel(volume, TransferFunction.from_json(one))
            for volume, one in zip(data.channels, functions, strict=True)
        ),
    }  # fmt: skip


def _labels(given: dict, volume: Volume) -> Labels:
    functions = {
        one["label"]: None if one["transfer_function"] is None else TransferFunction.from_json(one["transfer_function"])
        for one in given["functions"]
    }
    return Labels(volume, functions, smooth=bool(given["smooth"]))
