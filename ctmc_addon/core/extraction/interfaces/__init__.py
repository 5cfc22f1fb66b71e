# SPDX-License-Identifier: GPL-3.0-or-later
"""Several labels as one complex: which label owns a sample, and the triangles where two meet. Read in this order:

label_samples.py    the field of one label, held where it is not constant
owners.py           the label that owns every sample of the common grid
voxel_patterns.py   how the walls pass through a voxel of three labels or more
bands.py            the crossed edges and the triangles of some layers of samples
crossings.py        where on its edge each vertex lies, and the points inside faces and voxels
constants.py        the constants that keep the volumes of labels that touch
"""
