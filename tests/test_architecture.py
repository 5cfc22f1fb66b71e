# SPDX-License-Identifier: GPL-3.0-or-later
"""The house plan, held by reading the imports: which room may call which, and what each may need."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ctmc_addon"
ARROWS = {
    "core": set(),
    "reporting": {"core"},
    "readers": {"core"},
    "blender": {"reporting", "core"},
    "ui": {"blender", "readers", "reporting", "core"},
    "cli": {"blender", "readers", "reporting", "core"},
}
BLENDER = {"bpy", "bpy_extras", "bl_ui", "bl_operators", "addon_utils", "mathutils", "gpu", "blf", "bmesh"}
SOURCES = sorted(PACKAGE.rglob("*.py"))
FACES = {  # Packages that offer names to other rooms.
    path.parent for path in SOURCES if path.name == "__init__.py" and "\nfrom ." in path.read_text(encoding="utf-8")
}
# Runs `imports` on a Python where `blocked` do not exist.
BLOCKED_IMPORT = """
import sys
blocked = set(sys.argv[1].split(","))
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"{name} is not there", name=name)
sys.meta_path.insert(0, Blocker())
for name in sys.argv[2:]:
    __import__(name)
"""


def room_of(path: Path) -> str:
    """`core`, `ui`...; empty for the package's own files."""
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else ""


def named(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


@cache
def imports_of(path: Path) -> tuple[tuple[str, bool], ...]:
    """Every imported module as a dotted name from the package's root, and whether the import is relative."""
    return tuple(found_imports(path))


def found_imports(path: Path) -> Iterator[tuple[str, bool]]:
    folder = path.relative_to(PACKAGE).parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, False) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module or "", False
        elif isinstance(node, ast.ImportFrom):
            assert node.level - 1 <= len(folder), f"{path} reaches out of the package"
            base = folder[: len(folder) - (node.level - 1)]
            yield from ((".".join(filter(None, (*base, node.module, alias.name))), True) for alias in node.names)


def test_imports_follow_the_arrows():
    for path in SOURCES:
        room = room_of(path)
        for name, relative in imports_of(path):
            top, line = name.partition(".")[0], f"{named(path)} -> {name}"
            if relative:
                assert not room or top not in ARROWS or top == room or top in ARROWS[room], line
            else:
                assert top != "ctmc_addon", f"{line}: as an extension the package has another name: import relatively"
                assert room in {"ui", "blender", "cli", ""} or top not in BLENDER, f"{line}: must not know Blender"
                assert room != "core" or top == "numpy" or top in sys.stdlib_module_names, f"core must not need {line}"


def files_imported_by(path: Path) -> Iterator[Path]:
    """The files of the package that a file imports, wherever in it the import stands."""
    for name, relative in imports_of(path):
        if not relative:
            continue
        target = PACKAGE.joinpath(*name.split("."))
        for found in (target.with_suffix(".py"), target / "__init__.py", target.parent.with_suffix(".py")):
            if found.is_file():
                yield found
                break
        else:
            yield target.parent / "__init__.py"


def circles(arrows: dict[Path, set[Path]]) -> list[list[str]]:
    """The files in circles: what is left after taking away, again and again, who imports nobody or nobody imports."""
    left = dict(arrows)
    while True:
        imported = set().union(*left.values()) if left else set()
        gone = {path for path, targets in left.items() if not targets & left.keys() or path not in imported}
        if not gone:
            return [[named(path) for path in sorted(left)]] if left else []
        left = {path: targets for path, targets in left.items() if path not in gone}


def test_no_files_import_each_other_in_a_circle():
    assert circles({path: set(files_imported_by(path)) - {path} for path in SOURCES}) == []


def test_other_rooms_enter_a_package_by_its_face():
    behind = [
        f"{named(path)} -> {named(target)}"
        for path in SOURCES
        for target in files_imported_by(path)
        if room_of(target) != room_of(path) and target.name != "__init__.py" and target.parent in FACES
    ]
    assert behind == []


def test_a_circle_is_found_where_there_is_one():
    first, second, third = (PACKAGE / name for name in ("a.py", "b.py", "c.py"))
    assert circles({first: {second}, second: {first, third}, third: set()}) == [["a.py", "b.py"]]


def test_every_file_fits_a_few_screens():
    files = [*SOURCES, *(ROOT / "tools").rglob("*.py")]
    lengths = {path.relative_to(ROOT).as_posix(): len(path.read_text("utf-8").splitlines()) for path in files}
    assert {name: lines for name, lines in lengths.items() if lines > 445} == {}


def test_every_folder_holds_one_subject():
    counts = {named(folder): len(list(folder.glob("*.py"))) for folder in {path.parent for path in SOURCES}}
    assert {name: count for name, count in counts.items() if count > 15} == {}


NUMBERED_SOCKET = re.compile(r"\.(inputs|outputs)\[-?\d")


def test_no_socket_of_a_node_is_found_by_its_number():
    # Blender versions add sockets and reorder them; `blender/sockets.py` finds them by identifier or name.
    sources = [path for path in SOURCES if room_of(path) in ("blender", "ui")]
    lines = [(path.name, line) for path in sources for line in path.read_text("utf-8").splitlines()]
    assert [found for found in lines if NUMBERED_SOCKET.search(found[1])] == []
    assert NUMBERED_SOCKET.search("link(a.outputs[0], b)")


def import_without(blocked: set[str], *names: str) -> None:
    """Import `names` in a fresh Python that does not have `blocked`."""
    command = [sys.executable, "-W", "error", "-c", BLOCKED_IMPORT, ",".join(blocked), *names]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_core_and_readers_import_without_blender():
    import_without(BLENDER, "ctmc_addon", "ctmc_addon.core", "ctmc_addon.readers", "ctmc_addon.cli")


def test_the_choices_of_figures_are_known_without_blender():
    import_without(BLENDER, "ctmc_addon.blender.figure.spec", "ctmc_addon.core.files.mesh_files")


def test_core_and_readers_import_with_numpy_alone():
    # A zip for another platform brings no fitting wheels; the extension must still load and say so.
    libraries = {"imageio", "PIL", "tifffile", "pydicom", "pylibjpeg", "libjpeg", "openjpeg", "nibabel", "nrrd"}
    import_without(BLENDER | libraries, "ctmc_addon.core", "ctmc_addon.readers")


def test_every_source_file_names_its_license():
    listed = subprocess.run(
        ["git", "ls-files", "*.py", ".ci/run"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    files = [ROOT / name for name in listed.stdout.split()] or [*SOURCES, *(ROOT / "tests").rglob("*.py")]
    unnamed = [
        str(path) for path in files if "SPDX-License-Identifier: GPL-3.0-or-later" not in path.read_text("utf-8")
    ]
    assert unnamed == []


# The processor decides the order of these sums and the last bit of these functions. An `argsort` that is not stable
# swaps what is equal.
DIFFERING = {
    *(f"np.{name}" for name in ("linalg", "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "convolve")),
    *(f"np.{name}" for name in ("correlate", "polyfit", "argpartition", "power", "float_power", "cbrt", "degrees")),
    *(f"np.{name}" for name in ("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "radians")),
    *(f"np.{name}" for name in ("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh")),
    *(f"math.{name}" for name in ("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "cbrt")),
    *(f"math.{name}" for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh")),
}
ALLOWED = {
    # shown, and nothing is decided by it
    "core/maps/ramps.py": {"**"},
    "core/change/compare.py": {"math.log"},
    "core/mesh/angles/triangle_angles.py": {"math.atan"},
    "core/mesh/quality.py": {"np.arctan2", "np.degrees"},
    "core/mesh/rulers.py": {"math.atan2"},
    "core/preview.py": {"**"},
    "core/simplification/engine/component_removal.py": {"**"},
    "core/volume/statistics/histogram.py": {"math.log10", "np.log1p"},
    "core/volume/statistics/values.py": {"np.log1p"},
    "readers/dicom/series/stack_geometry.py": {"math.atan2"},
    # rounded far above the last bit
    "core/phantom/shapes.py": {"np.cos", "np.sin", "**"},
    "core/segmentation/competition/border.py": {"np.exp", "np.log"},
    "core/segmentation/competition/claims.py": {"**"},
    "core/smoothing/gaussian.py": {"math.exp"},
    "core/volume/labels/structure_colors.py": {"**"},
    "readers/dicom/series/listing.py": {"math.asin"},
    "readers/labels/colors.py": {"**"},
    # bounds with a margin, behind which all is compared exactly
    "core/mesh/diameter.py": {"math.log", "np.arcsin", "np.cos"},
    # whole numbers, and a permutation, which has no two that are equal
    "core/mesh/distance/triangle_tree.py": {"**"},
    "core/segmentation/competition/geodesic.py": {"argsort"},
    "readers/volumes/zarr_array.py": {"argsort"},
    # cubes of a power of two, which are exact
    "core/mesh/distance/discs.py": {"**"},
    "core/simplification/complexes/simplify.py": {"**"},
    "core/simplification/batches/reduced_batch.py": {"**"},
    "core/simplification/whole.py": {"**"},
}


def deciding_operations(source: str) -> set[str]:
    """Operations of a source that differ by the processor."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp | ast.AugAssign):
            left, right = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.target, node.value)
            is_square = isinstance(right, ast.Constant) and right.value == 2
            if isinstance(node.op, ast.MatMult):
                found.add("@")
            elif isinstance(node.op, ast.Pow) and not (is_square or isinstance(left, ast.Constant)):
                found.add("**")
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "argsort":
            if "kind" not in {keyword.arg for keyword in node.keywords}:
                found.add("argsort")
        elif isinstance(node, ast.Attribute):
            found |= {ast.unparse(node)} & DIFFERING
    return found


def test_core_and_readers_decide_by_operations_that_are_the_same_on_every_processor():
    sources = [path for room in ("core", "readers") for path in (PACKAGE / room).rglob("*.py")]
    found = {path.relative_to(PACKAGE).as_posix(): deciding_operations(path.read_text("utf-8")) for path in sources}
    assert {name: operations for name, operations in found.items() if operations} == ALLOWED


def test_an_operation_that_differs_is_found():
    differing = "a = b @ c\nd = np.exp(b) + math.tan(2) + x**0.3\nnp.argsort(d)"
    assert deciding_operations(differing) == {"@", "np.exp", "math.tan", "**", "argsort"}
    assert deciding_operations("a = x**2 + 2**n + np.sqrt(x)\nnp.argsort(a, kind='stable')") == set()
