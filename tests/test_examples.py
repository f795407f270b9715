"""The README's code prints what the README says, and every example runs."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def output_of(*command):
    """What a Python command prints; fails with its errors."""
    done = subprocess.run(
        [sys.executable, *map(str, command)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_readme_prints_what_it_says():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", readme, re.DOTALL).group(1)
    answer = re.search(r"```text\n(.*?)```", readme, re.DOTALL).group(1)
    assert output_of("-c", code) == answer


def test_setup_files_in_the_documentation_are_valid(tmp_path):
    from cyclopean import read_setup

    blocks = []
    for page in ("README.md", "docs/setup-files.md"):
        blocks += re.findall(r"```toml\n(.*?)```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 4
    camera = "[camera]\nsize_px = [1280, 960]\nfocal_px = 2400.0\n"
    for block in blocks:
        path = tmp_path / "setup.toml"
        path.write_text(block if "[camera]" in block else camera + block, encoding="utf-8")
        assert len(read_setup(path).rig()) >= 1


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_example_runs(example, tmp_path):
    assert output_of(example, tmp_path).strip()
