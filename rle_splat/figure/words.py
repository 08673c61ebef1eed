"""Names of segments as one reads them."""

import re

# Names of TotalSegmentator that need more than the side first, and what one reads: the first that fits counts.
_REWORDED = (
    (r"heart_(atrium|ventricle)_(left|right)", r"\2 \1"), ("heart_myocardium", "myocardium"),
    (r"(eye|kidney|lung|thigh)_(lens|cyst|\w+_lobe|\w+_compartment)_(left|right)", r"\2 of \3 \1"),
    (r"ventricle_(\w+_horn|body|trigone)_(left|right)", r"\1 of \2 lateral ventricle"),
    (r"rib_(left|right)_1", r"\1 1st rib"), (r"rib_(left|right)_2", r"\1 2nd rib"),
    (r"rib_(left|right)_3", r"\1 3rd rib"), (r"rib_(left|right)_(\d+)", r"\1 \2th rib"),
    (r"clavicula_(left|right)", r"\1 clavicle"), (r"hip_(left|right)", r"\1 hip bone"),
    (r"(tarsal|metatarsal|carpal|metacarpal)", r"\1 bones"), (r"phalanges_(feet|hand)", r"phalanges of \1"),
    ("vertebrae_body", "vertebral bodies"), (r"(?i:vertebrae?)[_ ]([CTLS]\d+)", r"\1"),
    (r"iliac_vena_(left|right)", r"\1 iliac vein"), ("pulmonary_vein", "pulmonary veins"),
    ("portal_vein_and_splenic_vein", "portal and splenic veins"), ("non_coronary_cusp", "noncoronary cusp"),
    (r"autochthon_(left|right)", r"\1 autochthonous back muscles"), ("coracobrachial", "coracobrachialis"),
    (r"prevertebral_(left|right)", r"\1 prevertebral muscles"), (r"sterno_thyroid_(left|right)", r"\1 sternothyroid"),
    ("lung_trachea_bronchia", "trachea and bronchi"), ("lung_covid_infiltrate", "COVID-19 infiltrate"),
    ("larynx_air", "laryngeal air"), ("body_trunc", "trunk"), ("body_extremities", "extremities"),
    (r"(sinus|teeth)_(maxillary|frontal|lower|upper)", r"\2 \1"),
    (r"(\w+)_fdi(\d\d)", r"\1 (\2)"), (r"(\w+)_fdi\d+", r"\1"),
)  # fmt: skip


def in_words(name: str) -> str:
    """The name of a segment as one reads it: ``kidney_left`` as "Left kidney", ``vertebrae_T12`` as "T12"."""
    found = (re.fullmatch(pattern, name) for pattern, _ in _REWORDED)
    reworded = next((one.expand(text) for one, (_, text) in zip(found, _REWORDED) if one), None)
    words = (name if reworded is None else reworded).replace("_", " ").split()
    if reworded is None:
        words.sort(key=lambda word: word not in ("left", "right"))  # the side first
    return words[0][0].upper() + " ".join(words)[1:]
