"""Imports inside the package only point down its layers, and importing it stays cheap."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import resolve_name
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "cyclopean"

# Lowest first. A module may import from itself and from the rows before its own, never from a neighbour.
LAYERS = (
    ("errors", "lazy"),
    ("geometry",),
    ("optics", "cameras"),
    ("rigs",),
    ("triangulation", "targets", "epipolar"),
    ("simulation", "rectification", "matching", "calibration", "correspondence"),
    ("analysis", "measurement", "fusion"),
    ("design", "experiments"),
    ("files", "plotting"),
    ("pipeline",),
    ("studio", "jobs"),
    ("cli",),
    ("__main__",),
)
# The matcher takes images and maps: it never sees a lens.
NEVER = {"matching": {"optics", "cameras", "rigs"}}
# What `import cyclopean` must leave for later, because it is slow to import.
HEAVY = {"numba", "cv2", "matplotlib", "scipy", "trimesh", "embreex", "pydantic"}

ROW = {name: row for row, names in enumerate(LAYERS) for name in names}


def imported(node: ast.AST, package: str) -> list[str]:
    """Full names of what an import statement in a module of `package` brings in; nothing for other nodes."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        source = resolve_name("." * node.level + (node.module or ""), package)
        return [f"{source}.{alias.name}" for alias in node.names]
    return []


def layer_imports(file: Path, root: Path) -> Iterator[tuple[int, str]]:
    """Line and layer of each import from the package at `root` in one of its files, functions included."""
    package = ".".join((root.name, *file.relative_to(root).parent.parts))
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        for name in imported(node, package):
            top, *inner = name.split(".")
            if top == root.name and inner != ["__version__"]:
                yield node.lineno, inner[0] if inner else root.name


def wrong_imports(root: Path) -> list[str]:
    """One line for each import in the package at `root` that its layers forbid."""
    wrong = []
    for file in sorted(root.rglob("*.py")):
        where = file.relative_to(root)
        if where == Path("__init__.py"):
            continue  # the front door shows all layers
        layer = where.parts[0].removesuffix(".py")
        if layer not in ROW:
            wrong.append(f"{where}: {layer} is no layer; give it a row in LAYERS")
            continue
        for line, target in layer_imports(file, root):
            if target not in ROW:
                wrong.append(f"{where}:{line}: {target} is no layer; import from where it is defined")
            elif target != layer and (ROW[target] >= ROW[layer] or target in NEVER.get(layer, ())):
                wrong.append(f"{where}:{line}: {layer} may not import {target}")
    return wrong


def test_imports_point_down_the_layers():
    assert wrong_imports(PACKAGE) == []


@pytest.mark.parametrize(
    ("file", "source", "fault"),
    [
        ("geometry/rays.py", "from ..rigs import View", "geometry may not import rigs"),
        ("geometry/rays.py", "from .. import rigs", "geometry may not import rigs"),
        ("geometry/__init__.py", "from ..rigs.view import View", "geometry may not import rigs"),
        ("errors.py", "import cyclopean.geometry.rays", "errors may not import geometry"),
        ("errors.py", "from cyclopean.geometry import Rays", "errors may not import geometry"),
        ("errors.py", "from . import geometry as g", "errors may not import geometry"),
        ("design.py", "def plan():\n    from .pipeline import run", "design may not import pipeline"),
        ("optics/prism.py", "from ..cameras import Camera", "optics may not import cameras"),
        ("simulation.py", "from .matching import Warps", "simulation may not import matching"),
        ("matching.py", "from .rigs import Rig", "matching may not import rigs"),
        ("analysis/a/b/c.py", "from ....cli import main", "analysis may not import cli"),
        ("cli.py", "from cyclopean import Setup", "Setup is no layer"),
        ("cli.py", "import cyclopean", "cyclopean is no layer"),
        ("helpers.py", "", "helpers is no layer"),
    ],
)
def test_a_wrong_import_is_found(tmp_path, file, source, fault):
    place = tmp_path / "cyclopean" / file
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(source)
    (found,) = wrong_imports(tmp_path / "cyclopean")
    assert fault in found


@pytest.mark.parametrize(
    ("file", "source"),
    [
        ("rigs/view.py", "import numpy\nfrom ..geometry.rays import Rays\nfrom .region import Region"),
        ("rigs/__init__.py", "from .view import View\nfrom . import region"),
        ("cli.py", "def main():\n    from . import errors, pipeline\n    from cyclopean import __version__"),
        ("__init__.py", "from .cli import main"),
        ("__main__.py", "from .cli import main"),
    ],
)
def test_a_right_import_is_let_through(tmp_path, file, source):
    place = tmp_path / "cyclopean" / file
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(source)
    assert wrong_imports(tmp_path / "cyclopean") == []


@pytest.mark.parametrize("module", ["cyclopean", "cyclopean.cli"])
def test_importing_leaves_the_heavy_packages_for_later(module):
    show = f"import sys, {module}; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", show], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert HEAVY & set(run.stdout.split()) == set()
