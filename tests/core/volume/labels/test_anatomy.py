# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors by anatomical names: every usual name is known, and what touches is told apart."""

import itertools
import tomllib
from pathlib import Path

import pytest

from ctmc_addon.core.volume.labels import anatomy
from ctmc_addon.core.volume.labels.anatomy import Anatomy, anatomy_of
from ctmc_addon.readers.labels.names.total_segmentator import NAMES

READABLE = 12.0  # CIE 1976; a just noticeable difference is 2.3
TOUCHING = """
liver: gallbladder, stomach, kidney_right, adrenal_gland_right, inferior_vena_cava, portal vein, hepatic vein, tumor,
  cyst, duodenum, colon, heart, lung_lower_lobe_right, diaphragm, bile duct, esophagus, artery, rib, skin, aorta, fat,
  pancreas, small_bowel, muscle, spleen
spleen: stomach, kidney_left, pancreas, colon, lung_lower_lobe_left, diaphragm, portal vein, adrenal_gland_left, tumor
kidney: adrenal gland, tumor, kidney_cyst, colon, iliopsoas, autochthon, renal artery, renal vein, ureter, duodenum,
  pancreas, small bowel, fat, stone, rib, inferior vena cava
pancreas: duodenum, stomach, portal vein, small_bowel, colon, tumor, cyst, pancreatic duct, aorta, artery, fat,
  inferior_vena_cava, adrenal gland
stomach: esophagus, duodenum, colon, small_bowel, tumor, diaphragm, fat, adrenal gland
duodenum: small_bowel, colon, gallbladder, inferior_vena_cava, aorta, bile duct
colon: small_bowel, urinary_bladder, rectum, tumor, gallbladder, hip, iliopsoas, fat
rectum: prostate, uterus, urinary_bladder, sacrum, seminal vesicle, vagina, tumor
urinary_bladder: prostate, uterus, small_bowel, tumor, seminal vesicle, hip, ureter
prostate: seminal vesicle
uterus: ovary, small_bowel, tumor
heart: aorta, lung, superior_vena_cava, inferior_vena_cava, pulmonary_vein, pulmonary artery, atrial_appendage_left,
  esophagus, sternum, coronary arteries, diaphragm, fat, pericardial effusion
heart_myocardium: heart_ventricle_left, heart_ventricle_right, heart_atrium_left, coronary arteries
heart_atrium_left: heart_ventricle_left, heart_atrium_right, pulmonary vein, esophagus, aorta
heart_atrium_right: heart_ventricle_right, superior_vena_cava, inferior_vena_cava
heart_ventricle_left: heart_ventricle_right, aorta
heart_ventricle_right: pulmonary artery
pulmonary_artery: aorta, pulmonary_vein, trachea, bronchi, embolism, superior_vena_cava, lung
atrial_appendage_left: pulmonary_vein, lung_upper_lobe_left, pulmonary artery, heart_atrium_left
aorta: brachiocephalic_trunk, common_carotid_artery_left, subclavian_artery_left, iliac_artery_left, esophagus,
  vertebrae_T8, vertebrae_T9, inferior_vena_cava, trachea, lung, celiac trunk, superior vena cava, thrombus
brachiocephalic_trunk: common_carotid_artery_right, subclavian_artery_right, trachea, brachiocephalic_vein_left
common_carotid_artery: subclavian_artery, thyroid_gland, jugular vein, trachea
superior_vena_cava: brachiocephalic_vein_left, trachea, lung
inferior_vena_cava: iliac_vena_left, hepatic vein, portal vein, vertebrae_L3, adrenal gland, renal artery
iliac_artery: iliac_vena, iliopsoas, hip, sacrum
portal vein: hepatic vein, hepatic artery, bile duct, gallbladder
lung_upper_lobe_left: lung_lower_lobe_left, rib_left_2, pulmonary artery
lung_upper_lobe_right: lung_middle_lobe_right, lung_lower_lobe_right, trachea
lung_middle_lobe_right: lung_lower_lobe_right
lung: bronchi, rib, trachea, tumor, esophagus, pleural effusion, diaphragm, lung vessels, skin
trachea: thyroid_gland, esophagus, bronchi, larynx
esophagus: thyroid_gland, vertebrae_T5, vertebrae_T6
vertebrae_C7: vertebrae_C6, vertebrae_T1, spinal_cord
vertebrae_L1: vertebrae_T12, vertebrae_L2, disc, autochthon, iliopsoas, aorta, tumor, rib_left_12
vertebrae_L4: vertebrae_L5, spinal_cord, intervertebral disc
vertebrae_S1: vertebrae_L5, sacrum, hip
vertebrae_T12: rib_right_12, lung
vertebrae_C1: skull, spinal_cord, brainstem
sacrum: vertebrae_L5, hip_left, gluteus_maximus_left, iliopsoas
hip: femur, gluteus_minimus, gluteus_medius, gluteus_maximus, iliopsoas, muscle, fat, implant
femur: iliopsoas, gluteus_maximus, gluteus_minimus, patella, tibia, implant
rib: costal_cartilages, scapula, clavicula, muscle
sternum: costal_cartilages, clavicula, skin
clavicula: scapula
scapula: humerus, muscle
humerus: ulna, muscle
tibia: fibula, patella, tarsal
gluteus_maximus: gluteus_medius, fat
gluteus_medius: gluteus_minimus, skin
autochthon: rib, gluteus_maximus, iliopsoas, gluteus_medius, fat
brain: skull, tumor, cerebrospinal fluid, cerebellum, brainstem, edema, eye, bleeding
cerebellum: brainstem, skull
gray matter: white matter, csf, thalamus
thalamus: white matter, csf
spinal_cord: brainstem, csf
skull: mandible, teeth, skin, eye, muscle
mandible: teeth, tongue, parotid gland
eye: lens, optic nerve, fat
skin: fat, muscle, breast, bone
bone: muscle, tumor, cartilage, fat, ligament, skin, artery, vein, nerve
artery: vein, nerve
muscle: tendon, fat, nerve, bone, vein, lymph node
lymph node: artery, vein, fat, tumor
"""


def neighbors():
    for block in TOUCHING.strip().replace("\n  ", " ").splitlines():
        name, others = block.split(":")
        yield from ((name, other.strip()) for other in others.split(","))


def lab(rgb):
    """CIE L*a*b* of an sRGB color under D65 (IEC 61966-2-1)."""
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in rgb))
    x = (0.4124 * red + 0.3576 * green + 0.1805 * blue) / 0.9505
    y = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    z = (0.0193 * red + 0.1192 * green + 0.9505 * blue) / 1.089
    f = [v ** (1 / 3) if v > 0.008856 else 7.787 * v + 16 / 116 for v in (x, y, z)]
    return 116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])


def difference(first, second):
    return sum((a - b) ** 2 for a, b in zip(lab(first.rgb), lab(second.rgb), strict=True)) ** 0.5


def test_the_difference_is_that_of_cie_1976():
    black, white = Anatomy((0, 0, 0), 1.0), Anatomy((255, 255, 255), 1.0)
    assert difference(black, white) == pytest.approx(100.0, abs=0.02)
    assert difference(white, white) == 0.0


@pytest.mark.parametrize(("first", "second"), list(neighbors()), ids=lambda name: name)
def test_what_touches_is_told_apart(first, second):
    one, other = anatomy_of(first), anatomy_of(second)
    assert one is not None
    assert other is not None
    assert difference(one, other) >= READABLE


@pytest.mark.parametrize("name", NAMES.values())
def test_every_class_of_total_segmentator_is_known(name):
    assert anatomy_of(name) is not None


def test_every_structure_of_the_table_is_found_by_each_of_its_names():
    table = tomllib.loads(Path(anatomy.__file__).with_suffix(".toml").read_text("utf-8"))
    for each in table["structures"]:
        assert each.keys() <= {"color", "opacity", "names"}
        shown = Anatomy(tuple(bytes.fromhex(each["color"][1:])), each.get("opacity", 1.0))
        assert 0.2 <= shown.opacity <= 1.0
        for name in each["names"]:
            assert anatomy_of(name) == shown, name


SAME = {
    "aorta": "aorta arota A_Aorta Bauchaorta Brustaorta",
    "mandible": "Bone_Mandible Unterkiefer",
    "nerve": "N.opticus OpticNerve_R Sehnerv_links",
    "liver": "Liver LIVER Leber hepar liver_segment_4 Liver-1 LiverSegmentation liver_mask",
    "tumor": "livertumor1 livertumor01 livertumors liver_tumor Lebertumor Tumour kidney_tumor lung_cancer lesion "
    "pancreatic-tumor colon_cancer_primaries Metastasen Lebermetastase GTV-1 GTVp "
    "GTVn_2 non-enhancing_tumor NierenzellKarzinom lungtumor2",
    "cyst": "kidney_cyst_left livercyst liverkyst Nierenzyste Leberzysten cysts kidney_cyst_right",
    "kidney": "leftkidney rightkidney kidneys Left_Kidney kidney_left Niere Nieren Niere_links linkeniere LeftKidney "
    "Ren_dexter kidney-l",
    "inferior vena cava": "V.cava_inferior venacava vena_cava_inferior IVC postcava inferior_vena_cava",
    "vein": "venoussystem hepatic_veins Lebervenen renal_vein Nierenvene vena_renalis veins",
    "portal vein": "portalvein portalvein1 portal_vein_and_splenic_vein Pfortader Vena_portae portal-vein",
    "artery": "A._hepatica arteries hepatic_artery "
    "Leberarterie arteria_hepatica iliac_artery_left renal_arteries artery2",
    "gallbladder": "Gallenblase gall_bladder gallbladder Gall_Bladder",
    "adrenal gland": "leftsurrenalgland rightsurrenalgland adrenal_gland_right Nebenniere Nebennieren left_adrenal",
    "small bowel": "smallintestin small_intestine Dünndarm Duenndarm",
    "lung": "leftlung rightlung lungs Lunge Lungen linke_Lunge left_lung pulmo_dexter",
    "bile duct": "biliarysystem bile_ducts Gallengang",
    "bone": "bones Knochen nasal_bone Fersenknochen",
    "rib": "rib_left_7 Rippe Rippen ribs costae",
    "muscle": "psoas_minor_muscle Brustmuskel musculus_rectus_abdominis muscles thigh_muscles",
    "skin": "Haut skin",
    "vertebra": "vertebrae Wirbel Lendenwirbel Lendenwirbelkörper vertebrae_C7 vertebra_T2",
    "spinal cord": "Rückenmark Rueckenmark spinal_cord nervus_opticus",
    "lung upper lobe": "lung_upper_lobe_left left_upper_lobe Oberlappen",
    "esophagus": "oesophagus Ösophagus Oesophagus Speiseröhre esophagus",
}


@pytest.mark.parametrize(("name", "other"), [(name, other) for name in SAME for other in SAME[name].split()])
def test_one_structure_has_one_color_under_all_its_names(name, other):
    assert anatomy_of(other) == anatomy_of(name) is not None


@pytest.mark.parametrize(
    "name",
    [
        "",
        "7",
        "structure 7",
        "Segment_1",
        "label 3",
        "ROI-2",
        "liver without tumor",
        "a",
        "a structure",
        "v 2",
        "PTV",
        "thoracic_cavity",
        "foo",
        "background",
    ],
)
def test_other_names_have_no_color(name):
    assert anatomy_of(name) is None


def test_the_first_of_two_structures_counts():
    assert anatomy_of("liver with tumor") == anatomy_of("liver (incl. tumor)") == anatomy_of("liver")
    assert anatomy_of("prostate/uterus") == anatomy_of("prostate_or_uterus") is not None
    assert anatomy_of("liver_with_tumor") == anatomy_of("liver")


def test_vertebrae_in_a_row_alternate():
    spine = [f"C{n}" for n in range(1, 8)] + [f"T{n}" for n in range(1, 13)] + [f"L{n}" for n in range(1, 6)] + ["S1"]
    seen = [anatomy_of(f"vertebrae_{vertebra}") for vertebra in spine]
    assert all(one != other for one, other in itertools.pairwise(seen))
    assert len(set(seen)) == 2


def test_what_hides_vessels_and_tumors_is_translucent():
    opacity = {name: anatomy_of(name).opacity for name in ("skin", "lung", "liver", "tumor", "bone", "vein", "artery")}
    assert opacity["skin"] < opacity["lung"] < opacity["liver"] < 1.0
    assert {opacity[name] for name in ("tumor", "bone", "vein", "artery")} == {1.0}
