# SPDX-License-Identifier: GPL-3.0-or-later
"""Color and opacity of a structure by its anatomical name, in English, German or Latin.

The names are those of the task `total` and others of TotalSegmentator (Wasserthal et al. 2023,
doi:10.1148/ryai.230024), of 3D Slicer's table GenericAnatomyColors (Halle et al.), of LiTS (Bilic et al. 2023,
doi:10.1016/j.media.2022.102680), KiTS (Heller et al. 2021, doi:10.1016/j.media.2020.101821), BTCV, AMOS and FLARE,
and of the masks of 3D-IRCADb-01, whose words are not separated (`livertumor1`, `leftkidney`, `venoussystem`).

The colors are our own, near what atlases show: arteries red, veins blue, bone ivory, bile green. Structures that
touch differ by 12 or more in CIELAB, which the test of this module holds with its list of neighbors. Sides and
numbers do not count, but for vertebrae, of which every second one is darker.
"""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from typing import NamedTuple


class Anatomy(NamedTuple):
    """How a structure is shown.

    Parameters
    ----------
    rgb : (red, green, blue) int
        sRGB, 0 to 255.
    opacity : float
        From 0, invisible, to 1: below 1 where what lies inside matters more, such as the vessels of a liver.
    """

    rgb: tuple[int, int, int]
    opacity: float


# A color as #RRGGBB, an opacity, and every name that has them; an indented line goes on. Plurals in s, es, n and en
# are found without being listed; umlauts are found as ä, ae and a.
TABLE = """
7A1C28 0.6 liver, hepar, leber, liver segment, liver parenchyma, hepatic parenchyma, leberparenchym
F2B824 1 tumor, tumour, lesion, mass, cancer, neoplasm, neoplasia, metastasis, metastases, nodule, herd, läsion,
  tumoren, metastase, karzinom, carcinoma, gtv, metastasectomie, necrosis, nekrose, hcc, lung nodule, raumforderung
8FD0E0 0.8 cyst, kyst, kyste, zyste, cystis, renal cyst, hepatic cyst
5F9A2C 1 gallbladder, gall bladder, gall, gallenblase, vesica biliaris, vesica fellea, bile, galle
9CCB3B 1 bile duct, biliary system, biliary tree, common bile duct, gallengang, gallenwege, ductus choledochus,
  choledochus, hepatic duct, cystic duct
7B4A86 1 spleen, milz, lien, splen
A65A38 1 kidney, niere, ren, renes, nephros, renal, kidney parenchyma, renal cortex, nierenrinde
7E3E26 1 renal medulla, nierenmark
D8BC48 1 ureter, harnleiter, renal pelvis, nierenbecken, pelvis renalis, urethra, harnröhre, urine
E2873A 1 adrenal gland, adrenal, suprarenal gland, suprarenal, surrenal gland, surrenalgland, surrenal, nebenniere,
  glandula suprarenalis, glandulae suprarenales
E6C39A 1 pancreas, pankreas, bauchspeicheldrüse
8A6A3A 1 pancreatic duct, pankreasgang, ductus pancreaticus
D77F86 1 stomach, magen, gaster, ventriculus, gastric
9C5058 1 esophagus, oesophagus, ösophagus, speiseröhre
EFA78C 1 small bowel, small intestine, smallintestin, intestinum tenue, dünndarm, jejunum, ileum, bowel, intestine,
  darm, bowel bag
C9685C 1 duodenum, zwölffingerdarm
B57A4C 1 colon, large bowel, large intestine, dickdarm, kolon, intestinum crassum, cecum, caecum, coecum, appendix,
  sigmoid, colon ascendens, colon transversum, colon descendens, colon sigmoideum, sigma, blinddarm, wurmfortsatz
7F4F3F 1 rectum, rektum, anus, enddarm, anal canal, colorectum
E9DC86 1 urinary bladder, bladder, harnblase, blase, vesica urinaria
C98AB0 1 prostate, prostata, vorsteherdrüse, prostate peripheral zone, prostate transition zone
A56BA0 1 seminal vesicle, samenblase, vesicula seminalis
D9688C 1 uterus, womb, gebärmutter, cervix, uterine cervix, vagina
F0B8C8 1 ovary, ovaries, eierstock, eierstöcke, ovarium, ovaria, testis, testes, testicle, hoden
F3C6BE 0.35 breast, brustdrüse, mamma, mammary gland
C2392E 1 heart, herz, cor, pericardium, perikard, herzbeutel, heart tissue
94232A 1 myocardium, heart myocardium, myokard, herzmuskel, left ventricular myocardium
E5583F 1 heart ventricle left, left ventricle, linker ventrikel, linke herzkammer, ventriculus sinister
F08E78 1 heart atrium left, left atrium, linker vorhof, atrium sinistrum
3F62B0 1 heart ventricle right, right ventricle, rechter ventrikel, rechte herzkammer, ventriculus dexter
6F97D8 1 heart atrium right, right atrium, rechter vorhof, atrium dextrum
E9A08C 1 atrial appendage, left atrial appendage, auricula, herzohr
E8663C 1 coronary artery, coronary arteries, coronary, koronararterie, herzkranzgefäß, herzkranzgefäße
D8191C 1 aorta, arota, hauptschlagader
E84A45 1 artery, arteries, arteria, arteriae, arterie, schlagader, arterial system, iliac artery, celiac trunk,
  truncus coeliacus, arterial, coeliac trunk, celiac artery, mesenteric artery, vascular, blood, blut, sma, smas
F2785A 1 brachiocephalic trunk, truncus brachiocephalicus
B8362E 1 subclavian artery, arteria subclavia
FA9C86 1 common carotid artery, carotid artery, carotid, arteria carotis, arteria carotis communis, internal carotid
  artery
2D4FA2 1 vein, venae, vena, vene, venous system, venoussystem, venous, hepatic vein, lebervene, hepatic vessel, liver
  vessel, lebergefäß, lebergefäße, vessel, blood vessel, gefäß, gefäße, capillary, capillaries, lung vessel, venous
  sinuses, sinus sagittalis
1F3270 1 inferior vena cava, vena cava inferior, venacava, vena cava, vena cava caudalis, ivc, postcava, untere
  hohlvene, hohlvene
39509A 1 superior vena cava, vena cava superior, svc, obere hohlvene
3E8FCB 1 portal vein, portal vein and splenic vein, splenic vein, portal, pfortader, vena portae, vena porta, portal
  system, portalvein, veins portal and splenic, superior mesenteric vein, milzvene, vena lienalis, vena splenica,
  pfortadersystem, smv
6A86CE 1 brachiocephalic vein, vena brachiocephalica, iliac vein, iliac vena, vena iliaca, jugular vein, drosselvene
6C7CD6 1 pulmonary artery, arteria pulmonalis, pulmonary trunk, truncus pulmonalis, lungenarterie
DE6258 1 pulmonary vein, vena pulmonalis, lungenvene
9A66B8 1 embolism, embolus, clot, thrombus, pulmonary embolism, lungenembolie
E8AAA4 0.5 lung, lunge, pulmo, pulmones, lung field, pulmonary
EDBDB4 0.5 lung upper lobe, upper lobe, lobus superior, oberlappen, lungenoberlappen
C48CA0 0.5 lung middle lobe, middle lobe, lobus medius, mittellappen, lungenmittellappen
D9928A 0.5 lung lower lobe, lower lobe, lobus inferior, unterlappen, lungenunterlappen
9CC7DE 1 trachea, luftröhre, airway, airways, atemwege, lung trachea bronchia, nasopharynx, oropharynx, hypopharynx,
  pharynx, rachen, nasal cavity, nasenhöhle, larynx air, auditory canal, sinus, nebenhöhle
5C9CC4 1 bronchus, bronchi, bronchia, bronchie, main bronchus
7FA9B8 0.5 pleural effusion, pleuraerguss, effusion, pericardial effusion, pleural pericard effusion, ascites, fluid,
  aszites
B0503C 1 thyroid gland, thyroid, schilddrüse, glandula thyroidea, thyreoidea
DDAA90 1 thymus, thymusdrüse
B8CFC0 1 larynx, kehlkopf, thyroid cartilage, cricoid cartilage
C58F7C 1 diaphragm, zwerchfell, diaphragma
E0A0A8 1 brain, gehirn, hirn, cerebrum, encephalon, gray matter, grey matter, central nervous system, head, frontal
  lobe, parietal lobe, occipital lobe, temporal lobe, insular cortex, central sulcus, cerebral cortex, cortex,
  großhirn
C77888 1 cerebellum, kleinhirn
C9A48C 1 brainstem, brain stem, hirnstamm, truncus encephali
B0707C 1 thalamus, caudate nucleus, caudate, lentiform nucleus, putamen, pallidum, hippocampus, amygdala, basal
  ganglia, basalganglien
F2E6DC 1 white matter, weiße substanz, internal capsule, septum pellucidum, cerebral white matter, corpus callosum
86BFE0 0.7 cerebro spinal fluid, cerebrospinal fluid, csf, liquor, brain ventricle, hirnventrikel, ventricle,
  subarachnoid space, lateral ventricle, third ventricle, fourth ventricle
F2DC4E 1 spinal cord, rückenmark, medulla spinalis, spinal canal, spinalkanal, nerve, nerv, nervus, optic nerve,
  sehnerv, chiasm, optic chiasm, spinalcord, myelon, cord
F4F4EE 1 eye, eyeball, auge, oculus, bulbus
A8D6EE 1 lens, eye lens, linse, augenlinse
D89A6E 1 parotid gland, parotid, ohrspeicheldrüse, glandula parotis, submandibular gland, salivary gland,
  speicheldrüse
C4626C 1 tongue, zunge, lingua
D0B4BC 1 gland, drüse, glandula, pituitary gland, pituitary, hypophyse
E9DFC6 1 skull, schädel, cranium, calvaria, schädelknochen
C9B88A 1 mandible, mandibula, unterkiefer, jaw, maxilla, oberkiefer, kiefer
FFFFF8 1 tooth, teeth, zahn, zähne, dens, dentes
E8DCBC 1 bone, knochen, os, ossa, skeleton, skelett, bony structure, foot, hand, bones, hyoid, zungenbein, zygomatic
  arch, styloid process, hard palate, gaumen, bone marrow, marrow
EBD7A0 1 vertebra, wirbel, wirbelkörper, vertebra body, spine, wirbelsäule, columna vertebralis, vertebral column,
  atlas, axis
98774A 1 sacrum, kreuzbein, sacral bone, coccyx, steißbein
F1EAD8 1 rib, rippe, costa, costae, ribs, rib cage, brustkorb, thorax
D3BE92 1 sternum, brustbein, breastbone
B8D0CC 1 costal cartilage, rippenknorpel, cartilage, knorpel, meniscus, meniskus, cartilago, cartilago costalis
92B4AE 1 intervertebral disc, intervertebral disk, disc, disk, bandscheibe, discus intervertebralis, vertebra disc
E8CB84 1 clavicle, clavicula, schlüsselbein, klavikula, collarbone
CDB98C 1 scapula, schulterblatt, skapula, shoulder blade
ECDFC0 1 humerus, oberarmknochen, radius, speiche, tibia, schienbein
C8B48A 1 ulna, elle, fibula, wadenbein, tarsal, metatarsal, carpal, metacarpal, phalanges hand
A3875A 1 patella, kniescheibe
C8B48A 1 phalanges feet, phalanx, fingerknochen, fußknochen, handwurzelknochen
F0E2C8 1 hip, hüfte, hip bone, hüftbein, hüftknochen, pelvis, becken, os coxae, ilium, ischium, pubis, beckenknochen
C2AA7C 1 femur, oberschenkelknochen, thigh bone, femoral head, femur head, hüftkopf, femurkopf
9C3A34 1 muscle, muskel, muskeln, musculus, musculi, skeletal muscle, muskulatur, quadriceps femoris, sartorius,
  gluteus maximus, thigh medial compartment, thigh posterior compartment, sternocleidomastoid, anterior scalene,
  scalene, levator scapulae, platysma, digastric, supraspinatus, infraspinatus, subscapularis, coracobrachial,
  serratus anterior, teres major, triceps brachii, biceps brachii, superior pharyngeal constrictor, middle pharyngeal
  constrictor, constrictor, soft palate
BE6052 1 gluteus medius, trapezius, pectoralis minor, pectoralis major, deltoid
78242A 1 gluteus minimus
8A4A3C 1 autochthon, erector spinae, autochthonous back muscle, rückenmuskulatur, autochthone rückenmuskulatur,
  rückenmuskel
B2464E 1 iliopsoas, psoas, psoas major, psoasmuskel, musculus psoas, iliacus
EBD28C 0.3 fat, fett, adipose tissue, fettgewebe, subcutaneous fat, torso fat, visceral fat, intermuscular fat, adeps,
  omentum
E9B99C 0.25 skin, haut, cutis, body surface, integument, derma, face, gesicht, external, außenkontur
DCA88C 0.25 body, organ, körper, corpus, body trunc, body trunk, body extremities, torso, rumpf, soft tissue,
  weichteile, tissue, gewebe
DBE0DE 1 ligament, tendon, sehne, connective tissue, bindegewebe, ligamentum, aponeurosis, fascia, faszie
86B04C 1 lymph node, lymphknoten, lymph nodes, lymphatic vessel, nodus lymphaticus, lymphgefäß, nodi lymphatici
D0A8C8 1 edema, oedema, ödem, inflammation, entzündung
8E1A1A 1 bleeding, hemorrhage, blutung, hematoma, hämatom, intracerebral hemorrhage, haemorrhage
D8D8B0 1 stone, kidney stone, gallstone, stein, nierenstein, gallenstein, calculus, calcification, verkalkung, kalk,
  plaque
8C6E3C 1 feces, waste, stool, stuhl
C8D4DC 0.6 gas, air, luft
A0A8B0 1 foreign object, implant, metal, metall, implantat, hip implant, stent, pacemaker, catheter, katheter,
  prosthesis
88949E 0.5 table, couch, tisch, patient table
"""

SECOND_VERTEBRA = Anatomy((0xC4, 0xA8, 0x6C), 1.0)
FIRST_OF_REGION = {"c": 1, "t": 8, "th": 8, "l": 20, "s": 25}  # of vertebrae, counted from the head
VERTEBRA_NUMBER = re.compile(r"(?<![a-z])(c|th?|l|s)[ _-]?(\d{1,2})(?!\d)")
SIDES = ("left", "right", "links", "rechts", "linke", "rechte", "linker", "rechter", "linkes", "rechtes", "sinister",
         "sinistra", "sinistrum", "dexter", "dextra", "dextrum", "bilateral", "both", "beide")  # fmt: skip
FILLERS = {*SIDES, "li", "re", "lt", "rt", "sin", "dex", "dx", "segmentation", "seg", "mask", "label", "roi", "ct",
           "structure", "region", "the", "whole", "entire", "total", "upper", "lower", "middle", "superior", "inferior",
           "anterior", "posterior", "lobe", "major", "minor", "part", "common", "internal", "external", "high",
           "res", "highres"}  # fmt: skip
NEGATIONS = {"no", "non", "not", "without", "ohne", "minus", "kein", "keine", "background", "hintergrund"}
FURTHER = re.compile(r"\b(?:and|with|incl\w*|und|mit|or|oder)\b|[/+&,;(]")
TUMOR = re.compile(r"^gtv|tumou?r|lesion|cancer|karzinom|carcinoma|metasta|neoplas|lasion")
CYST = re.compile(r"(?:[ck]yst|zyste)[esn]*$")
# Of Latin names ("V. cava inferior"), and of the names that AAPM's Task Group 263 gives structures.
ABBREVIATIONS = {"v.": "vena", "vv.": "venae", "a.": "arteria", "aa.": "arteriae", "m.": "musculus", "n.": "nervus",
                 "musc ": "musculus", "glnd ": "glandula", "bone ": "os"}  # fmt: skip
ABBREVIATED = re.compile(r"^(vv?\.|aa?\.|m\.|n\.|musc |glnd |bone ) *")
# What a name ends or begins with that is not listed itself.
HEADS = ("artery", "arteries", "arterie", "vein", "vene", "muscle", "muskel", "nerve", "nerv", "bone", "knochen",
         "wirbel", "wirbelkorper", "rippe", "aorta", "vessel", "gefass", "gefasse",
         "ligament", "tendon", "sehne", "cartilage", "knorpel",
         "gland", "druse", "lymph node", "lymphknoten", "fat", "effusion", "implant", "duct")  # fmt: skip
LATIN_HEADS = ("arteria", "vena", "musculus", "os", "nervus", "ligamentum", "glandula", "costa", "vertebra")
ALIASES = {"duct": "bile duct"}
PLURALS = ("s", "es", "n", "en", "e")


def anatomy_of(name: str) -> Anatomy | None:
    """Return color and opacity of the structure that a name means; None for a name that is not known.

    Upper and lower case, sides, numbers, spaces and underscores are not told apart; words may be glued.

    Examples
    --------
    >>> anatomy_of("Leber") == anatomy_of("liver_segment_4") == anatomy_of("liver")
    True
    >>> anatomy_of("livertumor1") == anatomy_of("Tumor"), anatomy_of("leftkidney") == anatomy_of("linke Niere")
    (True, True)
    >>> anatomy_of("skin"), anatomy_of("vertebrae_L4") == anatomy_of("vertebrae_L5"), anatomy_of("structure 7")
    (Anatomy(rgb=(233, 185, 156), opacity=0.25), False, None)
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    plain = _folded(spaced).replace("_", " ").replace("non-enhancing", "enhancing")
    plain = ABBREVIATED.sub(lambda found: ABBREVIATIONS[found[1]] + " ", plain)
    words = re.findall(r"[a-z]+", plain)
    if not words or NEGATIONS.intersection(words):
        return None
    number = VERTEBRA_NUMBER.search(plain)
    if number and any("vertebra" in word or "wirbel" in word for word in words):
        count = FIRST_OF_REGION[number[1]] + int(number[2]) - 1
        return _index()["vertebra"] if count % 2 else SECOND_VERTEBRA
    return _listed(words) or _first_of_several(spaced, plain) or _by_a_word(words)


def is_lesion(name: str) -> bool:
    """Return whether a name means a tumor or a cyst, of whatever organ.

    Examples
    --------
    >>> is_lesion("livertumor1"), is_lesion("Nierenzyste"), is_lesion("liver with tumor"), is_lesion("liver")
    (True, True, False, False)
    """
    return anatomy_of(name) in (_index()["tumor"], _index()["cyst"])


def _folded(name: str) -> str:
    """A name in small letters without accents; an umlaut and its spelling with an e are the plain letter."""
    letters = unicodedata.normalize("NFKD", name.casefold())
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    return re.sub(r"(?<=[aou])e", "", plain)


def _listed(words: list[str]) -> Anatomy | None:
    """What stands in the table for these words: as they are, without sides and numbers, and without where they lie."""
    long = [word for word in words if len(word) > 1]
    for chosen in (words, long, [word for word in long if word not in SIDES], [w for w in long if w not in FILLERS]):
        key = "".join(chosen)
        for plain in (key, *_without_sides(key)):
            found = _singular(plain)
            if found is not None:
                return found
    return None


def _without_sides(key: str) -> list[str]:
    """A glued name without a side at its beginning or end."""
    begins = [key[len(side) :] for side in SIDES if key.startswith(side)]
    return begins + [key[: -len(side)] for side in SIDES if key.endswith(side)]


def _singular(key: str) -> Anatomy | None:
    """What the table has for a key or for its singular."""
    stems = (key[: -len(ending)] for ending in PLURALS if key.endswith(ending))
    return next((_index()[stem] for stem in (key, *stems) if stem in _index()), None)


def _first_of_several(spaced: str, plain: str) -> Anatomy | None:
    """The first of two structures that a name counts: 'liver with tumor' is a liver."""
    first, *others = FURTHER.split(plain, maxsplit=1)
    return anatomy_of(first) if others and len(first) < len(spaced) else None


def _by_a_word(words: list[str]) -> Anatomy | None:
    """What a name is by its chief word: a tumor of anything, any artery, any muscle."""
    if TUMOR.search("".join(words)) or "mass" in words:
        return _index()["tumor"]
    if any(map(CYST.search, words)):
        return _index()["cyst"]
    key = "".join(word for word in words if word not in FILLERS and len(word) > 1)
    endings = {key, *(key[: -len(ending)] for ending in PLURALS if key.endswith(ending))}
    for head in HEADS:
        if any(ending.endswith(head.replace(" ", "")) for ending in endings):
            return _singular(_key(ALIASES.get(head, head)))
    if words[0] in LATIN_HEADS and len(words) > 1:  # 'os sacrum' is a sacrum, 'os pedis' a bone
        return _listed(words[1:]) or _index()[words[0]]
    return None


def _key(name: str) -> str:
    return "".join(re.findall(r"[a-z]+", _folded(name)))


@cache
def _index() -> dict[str, Anatomy]:
    """The table by its names, without spaces."""
    index: dict[str, Anatomy] = {}
    for line in TABLE.strip().replace("\n  ", " ").splitlines():
        color, opacity, names = line.split(" ", 2)
        red, green, blue = bytes.fromhex(color)
        for name in names.split(","):
            index.setdefault(_key(name), Anatomy((red, green, blue), float(opacity)))
    return index
