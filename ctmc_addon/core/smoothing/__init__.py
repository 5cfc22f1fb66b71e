# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing before extraction: a Gaussian, or the smoothest field that agrees with a label at every sample.

A new smoothing is a class in `methods`, a line of its registry, and a line of `choices`, which settings and languages
show. `prepare` makes the field of settings by them; nobody else asks which smoothing it is.

Read `constrained` in this order: `bricks` (where the work is done), `signed_distance` (the start), `bounds` (what is
known), `relaxation` (the smoothest field within it), `islands` (the volume of small components kept, found by
`label_components`), `volume_constant` (the volume of the whole kept), `constrained` (all of it in order),
`smooth_field` (what comes out). `between_labels` smooths the wall between two labels.
"""
