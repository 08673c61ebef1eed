"""Color and opacity of a segment by its anatomical name.

Names are those of TotalSegmentator, FreeSurfer, DICOM's code meanings and plain English.  Colors are from 3D Slicer's
table GenericAnatomyColors (Halle, Talos, Kikinis, Pieper, Aucoin, Jakab, 2010); gray matter and metastases have others.
"""

import re
from typing import NamedTuple

from ..scene.color import linear

# The opacity of a segment is that of 10 voxels: a body that is filled is seen through, a skin of few voxels is visible.
SEEN_THROUGH, HAZE, SHELL, VEIL = 0.01, 0.04, 0.25, 0.08
# Words, sRGB of 8 bits, opacity.  The first row one of whose words is in a name counts.
_ROWS = (
    ("cysts?", (205, 205, 100), 1.0),
    ("metastas[ie]s|neoplasms? secondary|secondary (neoplasms?|tumou?rs?)", (255, 60, 200), 1.0),
    ("neoplasms?|tumou?rs?|lesions?|mass|nodules?", (144, 238, 144), 1.0),
    ("false lumen", (140, 70, 170), 1.0),
    ("implants?|stents?|electrodes?|needles?|screws?", (220, 245, 20), 1.0),
    ("left atri(um|al)|atrium left|atrial appendage", (203, 108, 81), 1.0),
    ("right atri(um|al)|atrium right", (210, 115, 89), 1.0),
    ("heart ventricle|ventricle of heart", (181, 85, 57), 1.0),
    ("heart|myocardium|cardiac", (206, 110, 84), 1.0),
    ("pulmonary (veins?|venous)", (186, 77, 64), 1.0),
    ("pulmonary (arter(y|ies|ial)|trunk)", (0, 122, 171), 1.0),
    ("cartilages?|meniscus|discs?|discus", (111, 184, 210), 1.0),
    ("white matter|wm|corpus callosum", (250, 250, 225), 1.0),
    ("cerebell(um|ar)|cortex|ctx|gr[ae]y matter|gyrus|lobule", (214, 170, 158), 1.0),
    ("csf|ventricles?|lateral ventricle|choroid plexus", (88, 106, 215), 1.0),
    ("caudate", (30, 111, 85), 1.0),
    ("putamen", (210, 157, 166), 1.0),
    ("pallidum", (48, 129, 126), 1.0),
    ("amygdala", (98, 153, 112), 1.0),
    ("hippocamp(us|al)", (154, 150, 201), 1.0),
    ("thalamus", (166, 113, 137), 1.0),
    ("brain ?stem|midbrain|pons|medulla", (145, 92, 109), 1.0),
    ("spinal cord|nerves?|optic", (244, 214, 49), 1.0),
    ("teeth|tooth|molars?|incisors?|canines?", (255, 250, 220), 1.0),
    ("skull|crani(um|al)|mandible|maxilla|jaw", (241, 213, 144), 1.0),
    ("ribs?", (253, 232, 158), 1.0),
    ("sternum", (244, 217, 154), 1.0),
    ("vertebrae?|spine|sacrum|coccyx", (226, 202, 134), 1.0),
    ("clavicul?a|clavicles?|scapulae?", (205, 179, 108), 1.0),
    ("bones?|skeleton|humerus|radius|ulna|femur|tibia|fibula|patella|hips?|pelvis|tarsal|carpal|metatarsal"
     "|metacarpal|phalanges|fingers?|toes", (241, 214, 145), 1.0),
    ("veins?|venous|vena cava|venae?|portal", (0, 151, 206), 1.0),
    ("aorta|aortic|annulus|sinotubular", (224, 97, 76), 1.0),
    ("arter(y|ies|ial)|carotid|subclavian|trunk of artery|brachiocephalic trunk|coeliac|celiac|true lumen|vessels?"
     "|coronar(y|ies)|blood", (216, 101, 79), 1.0),
    ("bronch(us|i)|airways?", (175, 216, 244), 1.0),
    ("trachea", (182, 228, 255), 1.0),
    ("lungs?|pulmonary", (197, 165, 145), VEIL),
    ("liver|hepatic", (221, 130, 101), 1.0),
    ("spleen", (157, 108, 162), 1.0),
    ("kidneys?|renal", (185, 102, 83), 1.0),
    ("adrenal|suprarenal", (249, 186, 150), 1.0),
    ("pancreas", (249, 180, 111), 1.0),
    ("gall ?bladder", (139, 150, 98), 1.0),
    ("bladder", (222, 154, 132), 1.0),
    ("stomach", (216, 132, 105), 1.0),
    ("esophagus|oesophagus", (211, 171, 143), 1.0),
    ("duodenum", (255, 253, 229), 1.0),
    ("small bowel|small intestine|bowel", (205, 167, 142), 1.0),
    ("colon|rectum|large intestine", (204, 168, 143), 1.0),
    ("prostate", (230, 158, 140), 1.0),
    ("uterus", (255, 181, 158), 1.0),
    ("thyroid", (62, 162, 114), 1.0),
    ("thymus", (47, 150, 103), 1.0),
    ("lymph", (68, 172, 100), 1.0),
    ("eyes?|eyeball|globe", (194, 142, 0), 1.0),
    ("brain|cerebrum|cerebral", (214, 170, 158), 1.0),
    ("fat|adipose", (230, 220, 70), HAZE),
    ("muscles?|gluteus|autochthon|iliopsoas|psoas|quadriceps", (192, 104, 88), HAZE),
    ("skin|scalp", (177, 122, 101), SHELL),
    ("body|torso|trunc|trunk|extremities|head|face|tissues?", (177, 122, 101), SEEN_THROUGH),
)  # fmt: skip
_PATTERNS = tuple((re.compile(rf"\b(?:{words})\b"), linear([c / 255.0 for c in color]), opacity)
                  for words, color, opacity in _ROWS)  # fmt: skip


class Appearance(NamedTuple):
    """``color``: scene-linear RGB; ``opacity``: as of a solid ``LabelStyle``."""

    color: tuple
    opacity: float


def find_appearance(name: str) -> Appearance | None:
    """The appearance of a segment of this name; None if it names nothing known."""
    plain = " ".join(re.findall(r"[a-z]+", name.lower()))
    return next((Appearance(color, opacity) for pattern, color, opacity in _PATTERNS if pattern.search(plain)), None)
