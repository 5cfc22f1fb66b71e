# SPDX-License-Identifier: GPL-3.0-or-later
"""What runs on GitHub: actions pinned by commit, uploads that wait for somebody, files for archives that agree."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
pytestmark = pytest.mark.once


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_every_action_is_pinned_by_its_commit_and_says_its_version(path):
    used = re.findall(r"^.*\buses: (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    assert used
    assert [line for line in used if not re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", line)] == []


def test_one_action_has_one_commit():
    used = {found for path in WORKFLOWS for found in re.findall(r"uses: (\S+)@(\w+)", path.read_text("utf-8"))}
    assert len(used) == len({name for name, _ in used})


def test_uploads_wait_for_somebody_and_have_no_more_rights_than_they_need():
    text = (ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8")
    jobs = dict(re.findall(r"^  (\w+):\n((?:    .*\n|\n)+)", text, re.MULTILINE))
    for job, environment in (("pypi", "pypi"), ("extension", "blender-extensions")):
        assert f"    environment: {environment}\n" in jobs[job]
        assert "contents: write" not in jobs[job]
    assert re.findall(r"^permissions:\n((?:  .*\n)+)", text, re.MULTILINE) == ["  contents: read\n"]
    assert [job for job, body in jobs.items() if "secrets." in body] == ["extension"]


def test_the_archive_names_the_license_and_the_authors_of_the_citation():
    archive = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nlicense: {archive['license']}\n" in citation
    assert [one["name"] for one in archive["creators"]] == re.findall(r'^  - name: "(.*)"$', citation, re.MULTILINE)
    assert archive["keywords"] == re.findall(r"^  - (\w.*)$", citation[citation.index("keywords") :], re.MULTILINE)[:5]
