"""Bytes from files, and whole files or none: what all formats share."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import re
import secrets
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import CyclopeanError, ImageError, OutputError, SetupError

PathLike = str | os.PathLike[str]


def read_bytes(path: PathLike, error: type[CyclopeanError]) -> bytes:
    """The content of a file that must not be empty; `error` says why there is none."""
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as fault:
        raise error(f"{path}: {_why_unread(fault, path)}") from fault
    if not data:
        raise error(f"{path}: the file is empty (0 bytes); was it copied whole?")
    return data


def read_arrays(path: PathLike, names: Collection[str], kind: str) -> dict[str, np.ndarray]:
    """Those of the named arrays that an NPZ file holds; an ImageError that names the kind of file where it is none."""
    data = read_bytes(path, ImageError)
    if not data.startswith(b"PK"):
        raise ImageError(f"{path}: this is no NPZ file, so it is no {kind}")
    try:
        with np.load(io.BytesIO(data)) as file:
            return {name: file[name] for name in names if name in file}
    except (ValueError, OSError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile, zlib.error) as fault:
        raise ImageError(f"{path}: the {kind} is truncated or damaged; copy it again ({fault})") from fault


def read_text(path: PathLike, kind: str) -> str:
    """The text of a file that must not be empty; `kind` says what it would be, as in "setup file"."""
    try:
        return read_bytes(path, SetupError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SetupError(f"{path}: this is no text (UTF-8), so it is no {kind}") from None


def parse_toml(text: str, path: PathLike, parse_float: Callable[[str], Any] = float) -> dict[str, Any]:
    """What a TOML text holds; `path` is named when it is none."""
    try:
        return tomllib.loads(text, parse_float=parse_float)
    except (ValueError, RecursionError) as fault:
        raise SetupError(f"{path}: this is not TOML: {fault}") from None


def on_one_line(toml: str) -> str:
    """A TOML text with each array on its own line, as a person would write it."""
    toml = re.sub(r"(\[)\n +|,\n *(\])", r"\1\2", toml)
    return re.sub(r",\n +", ", ", toml)


def _why_unread(fault: OSError, path: Path) -> str:
    folder = path.absolute().parent
    if isinstance(fault, FileNotFoundError):
        return f"there is no such file in {folder}" if folder.is_dir() else f"there is no folder {folder}"
    if isinstance(fault, IsADirectoryError):
        return "this is a folder; name a file in it"
    if isinstance(fault, PermissionError):
        return "no permission to read the file"
    return str(fault.strerror)


@contextmanager
def replacing(path: PathLike) -> Iterator[BinaryIO]:
    """A file open for writing that takes the place of `path` when the block ends, and vanishes when it fails.

    Raises
    ------
    OutputError
        With the reason, when the file cannot be written.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))  # a link stays, what it points at is replaced
    part = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        _check_target(target)
        with open(part, "xb") as file:
            yield file
        os.replace(part, target)
    except OSError as fault:
        raise OutputError(f"{path}: cannot be written: {_why_unwritten(fault, target.parent)}") from fault
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _check_target(target: Path) -> None:
    if not target.exists():
        return
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "this is a folder; name a file in it")
    if not target.is_file():
        raise OSError(errno.EINVAL, "this is no ordinary file")
    if not os.access(target, os.W_OK):
        raise OSError(errno.EPERM, "the file is write-protected")


def _why_unwritten(fault: OSError, folder: Path) -> str:
    if isinstance(fault, FileNotFoundError):
        there = f"nothing can be made in {folder}; choose another folder"  # the system's own, such as /proc
        return there if folder.is_dir() else f"there is no folder {folder}; make it first"
    if isinstance(fault, FileExistsError | NotADirectoryError):
        blocker = next((place for place in (folder, *folder.parents) if place.is_file()), folder)
        return f"{blocker} is a file, not a folder"
    if fault.errno == errno.EACCES:
        return f"no permission to write in {folder}"
    if fault.errno == errno.ENOSPC:
        return f"the disk that holds {folder} is full"
    return str(fault.strerror or fault)


def write_csv(path: PathLike, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table as CSV, whole or not at all."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    with replacing(path) as file:
        file.write(text.getvalue().encode())


def write_json(path: PathLike, document: object) -> None:
    """Write what JSON can hold, whole or not at all; NaN and infinity it cannot."""
    text = json.dumps(document, indent=1, allow_nan=False) + "\n"
    with replacing(path) as file:
        file.write(text.encode())


def output_folder(path: PathLike) -> Path:
    """Make a folder, with those above it, and prove that files can be written there: before the work, not after.

    Raises
    ------
    OutputError
        With the reason, when the folder cannot be made or written to.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"cyclopean")
    except OSError as fault:
        place = folder.absolute()
        if isinstance(fault, FileNotFoundError):
            place = next(known for known in (place, *place.parents) if known.is_dir())
        reason = _why_unwritten(fault, place)
        raise OutputError(f"{folder}: results cannot be written there: {reason}") from fault
    return folder
