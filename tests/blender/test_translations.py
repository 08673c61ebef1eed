"""Every text of the interface has a German translation, and no translation is left over."""

import re
from collections import Counter

import bpy
import pytest

from tests.blender import ui_strings
from tests.blender.real_blender import MODULE

FILE = "bridge/translations/de_DE.json"
WITH_SOURCES = pytest.mark.skipif(
    not (ui_strings.ROOT / "bridge").is_dir(), reason="the add-on's sources are not beside the tests"
)


@pytest.fixture
def german(bridge):
    return bridge("translations").languages()["de_DE"]


@WITH_SOURCES
def test_every_text_has_a_german_translation(german, addon):
    texts = {**ui_strings.registered(MODULE), **ui_strings.written(), **ui_strings.of_the_renderer(MODULE)}
    assert len(texts) > 700
    missing = [
        f'{where}: "{text}"' for text, where in sorted(texts.items(), key=lambda pair: pair[1]) if not german.get(text)
    ]
    assert not missing, f"add these texts with their translations to {FILE}:\n" + "\n".join(missing)
    unused = sorted(set(german) - set(texts))
    assert not unused, f"take these texts out of {FILE}, nothing shows them any more:\n" + "\n".join(unused)


def test_translations_end_as_the_texts_do(german):
    """Tooltips have no final period, sentences have one, and a menu's ellipsis stays."""
    wrong = [text for text, words in german.items() for end in ".…"
             if text.endswith(end) != words.endswith(end) and not words.endswith(".)")]  # fmt: skip
    assert not wrong, "\n".join(wrong)


def test_a_name_is_written_in_one_way(german):
    """Not X-ray here and X-Ray there."""
    ways = Counter(text.casefold() for text in german)
    assert [text for text in german if ways[text.casefold()] > 1] == []


@WITH_SOURCES
def test_texts_of_all_kinds_are_found(addon):
    registered, written = ui_strings.registered(MODULE), ui_strings.written()
    for text, file in (
        ("Turntable", "operators/turntable.py"), ("Maximum Error", "bridge/data/properties.py"),
        ("Interpolate", "bridge/data/properties.py"), ("Cut", "panels/clip_objects.py"),
        ("Shape of the cut", "operators/add_cutting_object.py"),
    ):  # fmt: skip
        assert registered[text] == file
    for text in ("Load from File", "Canceled; nothing was changed.", "Select one of the volumes in the scene"):
        assert written[text].partition(":")[0].endswith(".py")


def test_the_interface_speaks_german(addon):
    """In a Blender with languages; the module bpy is built without."""
    if "de_DE" not in bpy.app.translations.locales:
        pytest.skip("this Blender has no translations")
    view = bpy.context.preferences.view
    before = view.language
    view.language = "de_DE"
    try:
        assert bpy.app.translations.pgettext_iface("Show in Renders") == "In Renderings zeigen"
        addon.unregister()
        assert bpy.app.translations.pgettext_iface("Show in Renders") == "Show in Renders"
        addon.register()
        assert bpy.app.translations.pgettext_iface("Show in Renders", "Operator") == "In Renderings zeigen"
    finally:
        view.language = before


@WITH_SOURCES
def test_sentences_of_the_renderer_are_translated(bridge, german, monkeypatch):
    """Templates that no source composes any more would translate nothing."""
    translations = bridge("translations")
    said = ui_strings.said_by_the_renderer()
    ours = *translations.COMPOSED, *ui_strings.WHOLE
    stale = [text for text in ours if re.sub(r"\{\w+\}", "{}", text) not in said]
    assert not stale, "\n".join(stale)
    monkeypatch.setattr(translations, "pgettext_iface", lambda text, *_: german.get(text, text))
    for sentence, expected in (
        ("Unit, name and modality do not say what the volume is, so values above 48.5 are shown.",
         "Einheit, Name und Modalität sagen nicht, was das Volumen ist; gezeigt werden Werte über 48.5."),
        ("Preset CT Bone: the values are Hounsfield units and include bone.",
         "Vorgabe CT Bone: die Werte sind Hounsfield-Einheiten und enthalten Knochen."),
        ("Preset CT Lung: the modality is CT and the name of the volume contains lung.",
         "Vorgabe CT Lung: die Modalität ist CT und der Name des Volumens enthält lung."),
        ("Rendering post simpson 2 bilinear, about 5 s", "Rendern von post simpson 2 bilinear, etwa 5 s"),
        ("reading Shading", "Lesen von Shading"),
        ("There is no file /scans/head.nii; check the path.",
         "Es gibt keine Datei /scans/head.nii; prüfen Sie den Pfad."),
        ("A picture of 9000 x 8000 pixels needs about 4.5 GiB of memory and 2.0 GiB are free; 6000 x 5333 pixels would "
         "fit.",
         "Ein Bild von 9000 x 8000 Pixeln braucht etwa 4.5 GiB Speicher, und 2.0 GiB sind frei; 6000 x 5333 Pixel "
         "würden passen."),
        ("The camera does not see the volume; point it at the volume, or move the volume between its clip distances.",
         "Die Kamera sieht das Volumen nicht; richten Sie sie darauf, oder bringen Sie das Volumen zwischen ihre "
         "Clip-Abstände."),
        ("Nobody translates this.", "Nobody translates this."),
    ):  # fmt: skip
        assert translations.translate(sentence) == expected
    assert translations.filled("Imported {volume}.", volume="head") == "head importiert."


def test_translated_templates_have_the_fields_of_theirs(german):
    fields = re.compile(r"\{\w+\}")
    wrong = [text for text, words in german.items() if sorted(fields.findall(text)) != sorted(fields.findall(words))]
    assert not wrong, "\n".join(wrong)


def test_errors_of_operators_are_translated(bridge, german, monkeypatch, tmp_path):
    monkeypatch.setattr(bridge("translations"), "pgettext_iface", lambda text, *_: german.get(text, text))
    with pytest.raises(RuntimeError, match=r"Es gibt keine Datei .*missing\.nii; prüfen Sie den Pfad"):
        bpy.ops.rle_splat.import_volume(filepath=str(tmp_path / "missing.nii"))
    image = tmp_path / "photo.xyz"
    image.write_bytes(b"no voxels")
    with pytest.raises(RuntimeError, match=r"photo\.xyz hat keine Endung eines bekannten Formats"):
        bpy.ops.rle_splat.import_volume(filepath=str(image))
