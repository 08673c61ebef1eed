"""Colors and opacities of segments by their names."""

import pytest

from rle_splat.classify.anatomy import SEEN_THROUGH, SHELL, VEIL, find_appearance

# Names as TotalSegmentator, FreeSurfer and DICOM SEG write them, and a plain one of the same kind.
SAME = {
    "bone": ("hip_left", "femur_right", "Bone"), "liver": ("Liver", "liver"),
    "vein": ("inferior_vena_cava", "portal_vein_and_splenic_vein", "iliac_vena_left", "brachiocephalic_vein_left"),
    "artery": ("common_carotid_artery_right", "brachiocephalic_trunk", "Coronary arteries"),
    "white matter": ("Left-Cerebral-White-Matter", "wm-lh-precuneus"),
    "CSF": ("Left-Lateral-Ventricle", "3rd-Ventricle"),
    "cortex": ("Left-Cerebellum-Cortex", "ctx-rh-superiorfrontal", "Brain"),
    "kidney": ("kidney_left", "Right kidney"),
    "tumor": ("Neoplasm, Primary", "liver_tumour", "Lung nodule"),
    "metastasis": ("Neoplasm, Secondary", "liver_metastases"),
    "cyst": ("kidney_cyst_left",),
    "muscle": ("gluteus_medius_left", "autochthon_right", "skeletal_muscle"),
}  # fmt: skip


@pytest.mark.parametrize("known", SAME)
def test_names_of_one_tissue_look_alike(known):
    assert {find_appearance(name) for name in (known, *SAME[known])} == {find_appearance(known)} != {None}


def test_tissues_differ():
    assert len({find_appearance(known) for known in SAME}) == len(SAME)


def test_what_is_around_organs_is_clear():
    clear = [find_appearance(name).opacity for name in ("body_trunc", "skin", "lung_upper_lobe_left")]
    assert clear == [SEEN_THROUGH, SHELL, VEIL]
    assert find_appearance("heart_ventricle_left").opacity == find_appearance("vertebrae_L3").opacity == 1.0


def test_the_heart_has_its_own_ventricles():
    assert find_appearance("heart_ventricle_left") != find_appearance("Left-Lateral-Ventricle")


@pytest.mark.parametrize("name", ["", "Label 3", "Segment_1", "thing", "42"])
def test_other_names_are_unknown(name):
    assert find_appearance(name) is None


def test_colors_are_scene_linear():
    assert find_appearance("bone").color == pytest.approx((0.8796, 0.6724, 0.2831), abs=1e-3)
