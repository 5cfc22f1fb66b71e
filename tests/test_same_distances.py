# SPDX-License-Identifier: GPL-3.0-or-later
"""Panel, figure and experiment print the same distances for the same pair of surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import distance_mm

pytest.importorskip("bpy")
pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.page.sheet import sheet_steps
from ctmc_addon.blender.figure.spec import Comparison, FigureStyle, Page
from ctmc_addon.cli.experiment.common import distances_steps
from ctmc_addon.cli.experiment.simplify import simplify_levels_steps
from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.ui.state.results.measurements import measurement_steps


def test_panel_figure_and_experiment_have_one_estimator(tmp_path):
    volume = Volume((100 - 5 * distance_mm((24, 24, 24))).astype(np.float32), np.eye(4), name="ball")
    settings = ReconstructionSettings(threshold=60.0)
    full = reconstruct(volume, settings)
    simplified = reconstruct(volume, replace(settings, reduction=0.5))
    expected = surface_distance(simplified.mesh, full.mesh)
    assert 0 < expected.mean < expected.percentile_95 < expected.largest

    panel = finish(measurement_steps(simplified.mesh, full.mesh)).distance
    comparison = Comparison(levels=[50.0])
    _, cells = finish(sheet_steps(volume, settings, comparison, tmp_path / "a.png", Page(60.0, 40.0), FigureStyle()))
    built_in, _ = finish(simplify_levels_steps(full.mesh, [50.0], 1))
    [experiment] = finish(distances_steps([built_in.mesh], full.mesh))
    assert panel == experiment == expected
    for measured in cells:
        assert measured.distance == expected
