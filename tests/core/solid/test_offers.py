# SPDX-License-Identifier: GPL-3.0-or-later
"""What a refusal offers works when it is given: walls, drains, planes and pegs of random sizes."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import CtmcError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.solid import Bar, Cut, Drain, Pegs, SolidRequest, solid_parts
from ctmc_addon.readers import read_volume

pytestmark = pytest.mark.once

SIZE = 24
NUMBERS = r"((?:-?[\d.e+]+(?:e-\d+)? ?)+)"


def form(name):
    at = np.indices((SIZE,) * 3)[::-1].reshape(3, -1).astype(float) - 11.4
    if name == "ball":
        depth = 9.3 - np.linalg.norm(at, axis=0)
    elif name == "capsule":
        depth = Bar((-4.2, -2.5, 0.7), (5.1, 2.6, -0.4), 5.3).at(at)
    elif name == "torus":
        depth = 3.7 - np.hypot(np.hypot(at[0], at[1]) - 6.4, at[2])
    else:
        depth = (np.array([[8.3], [4.1], [6.2]]) - np.abs(at)).min(axis=0)
    values = depth.astype(np.float32).reshape((SIZE,) * 3)
    return Volume(values, np.diag([1.0, 1.0, 1.0, 1.0]), name=name), ReconstructionSettings(threshold=0.0), ()


@pytest.fixture
def patient(real):
    labels = replace(read_volume(real("ts_nifti") / "example_seg_fast_force_split.nii.gz"), kind="label")
    return lambda label: (labels, ReconstructionSettings(), (label,))


def box_of(subject):
    volume, settings, labels = subject
    mesh = reconstruct(volume, replace(settings, label=labels[0] if labels else None)).mesh
    return mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)


def made(subject, **solid):
    volume, settings, labels = subject
    return solid_parts(volume, settings, SolidRequest(**solid), labels)


def refusal(subject, **solid):
    with pytest.raises(CtmcError) as refused:
        made(subject, **solid)
    return str(refused.value)


def offered(text, before):
    found = re.search(before + NUMBERS, text)
    assert found, text
    return [float(number) for number in found[1].split()]


def assert_wall_works(subject, drains, rng):
    low, high = box_of(subject)
    wall = (high - low).min() * rng.uniform(0.5, 3.0)
    text = refusal(subject, hollow=wall, drains=drains)
    (thinner,) = offered(text, "--hollow ")
    (part,) = made(subject, hollow=thinner, drains=drains)
    assert part.mesh.euler != 2 or part.mesh.components > 1


def assert_drain_works(subject, wall, rng):
    _, high = box_of(subject)
    point, diameter = high + rng.uniform(1, 9, 3), rng.uniform(1.0, 2.0) * wall
    text = refusal(subject, hollow=wall, drains=(Drain(diameter, tuple(point)),))
    better = tuple(offered(text, "give a point inside, such as "))
    (part,) = made(subject, hollow=wall, drains=(Drain(diameter, better),))
    assert part.printing.closed_cavities == 0


def assert_plane_works(subject, rng):
    low, high = box_of(subject)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    point = (low + high) / 2 + normal * np.linalg.norm(high - low) * rng.uniform(0.6, 2)
    text = refusal(subject, cuts=(Cut(tuple(point), tuple(normal)),))
    better = tuple(offered(text, "such as to "))
    assert len(made(subject, cuts=(Cut(better, tuple(normal)),))) == 2


def assert_pegs_work(subject, rng, **solid):
    low, high = box_of(subject)
    diameter = (high - low).min() * rng.uniform(0.6, 1.2)
    length, clearance = diameter * rng.uniform(0.5, 2.0), diameter * rng.uniform(0.0, 0.03)
    cut = Cut(tuple((low + high) / 2 + rng.uniform(-0.02, 0.02, 3) * (high - low)), tuple(rng.normal(size=3)))
    text = refusal(subject, cuts=(cut,), pegs=Pegs(2, diameter, length, clearance), **solid)
    thinner, shorter = offered(text, "--peg-mm ")
    pegs = Pegs(1, thinner, shorter, clearance)
    parts = made(subject, cuts=(cut,), pegs=pegs, **solid)
    assert len(parts) == 2


@pytest.mark.parametrize(("name", "seed"), [("ball", 1), ("torus", 2), ("box", 3)])
def test_what_is_offered_for_a_closed_form_works(name, seed):
    rng = np.random.default_rng(seed)
    subject = form(name)
    assert_wall_works(subject, (Drain(3.0),) if seed == 1 else (), rng)
    assert_drain_works(subject, 1.5, rng)
    assert_plane_works(subject, rng)


@pytest.mark.parametrize(("name", "seed", "wall"), [("ball", 1, 0.0), ("capsule", 2, 1.5), ("box", 3, 0.0)])
def test_pegs_that_are_offered_for_a_closed_form_fit(name, seed, wall):
    assert_pegs_work(form(name), np.random.default_rng(seed), hollow=wall)


@pytest.mark.parametrize("label", [29, 52], ids=["vertebra", "aorta"])
def test_what_is_offered_for_a_patient_works(patient, label):
    rng = np.random.default_rng(label)
    subject = patient(label)
    assert_wall_works(subject, (), rng)
    assert_plane_works(subject, rng)
    assert_pegs_work(subject, rng)
