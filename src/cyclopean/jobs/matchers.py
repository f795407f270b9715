"""The matcher that a person asks for by name: our own, OpenCV's, or a function of theirs."""

from __future__ import annotations

import difflib
import importlib
import sys
from collections.abc import Callable
from functools import partial
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from ..errors import SetupError
from .console import console

if TYPE_CHECKING:
    from ..matching.pairwise import PairMatcher
    from ..pipeline import Reconstruction

OURS = "cyclopean"
_CHOICES = f"{OURS}, sgbm, sgbm-3way, FILE.py:FUNCTION or package.module:function"


class Engine(NamedTuple):
    """What turns a photograph into depth."""

    run: Callable[..., Reconstruction]  # (photograph, rig, depths, *, progress, keep)
    settings: list[tuple[str, str]]  # name and value, for the report


def chosen_engine(words: str, scale: float, step: float, memory_mib: float, strict: bool = True) -> Engine:
    """Our own matcher, or rectified pairs with the one that `words` stand for (`find_matcher`)."""
    from .. import pipeline

    matcher = find_matcher(words)
    if matcher is None:
        kept = ("depths kept", "that pixels tell by themselves" if strict else "also weak ones (--no-strict)")
        run = partial(pipeline.reconstruct, step=step, memory_mib=memory_mib, strict=strict)
        return Engine(run, [("matcher", words), ("step between hypotheses (px)", f"{step:g}"), kept])
    run = partial(pipeline.reconstruct_by_pairs, matcher=matcher, scale=scale, warn=_warn)
    settings = [
        ("matcher", f"{words}, on rectified pairs"),
        ("scale of rectified pictures", f"{scale:g}"),
        ("assumed noise of a disparity (px of the photograph)", f"{pipeline.DISPARITY_NOISE:g}"),
    ]
    return Engine(run, settings)


def find_matcher(words: str) -> PairMatcher | None:
    """The matcher of rectified pairs that words on the command line stand for; None for our own, which needs no pairs.

    Parameters
    ----------
    words : str
        cyclopean, sgbm, sgbm-3way, FILE.py:FUNCTION or package.module:function. Modules are looked for in the present
        folder too, and what a file imports beside it is found, as when Python runs it.

    Raises
    ------
    SetupError
        Where there is no such file, module or function, or it cannot be imported: what is wrong, and where.
    """
    if words == OURS:
        return None
    if words in ("sgbm", "sgbm-3way"):
        from ..matching.pairwise import sgbm

        return sgbm() if words == "sgbm" else sgbm(mode="3way", grey=True)
    home, colon, name = words.rpartition(":")
    if not colon and words.endswith(".py"):
        raise SetupError(f"--matcher {words} does not say which function: wanted {words}:FUNCTION")
    if not (colon and home and name):
        near = difflib.get_close_matches(words, [OURS, "sgbm", "sgbm-3way"], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise SetupError(f"--matcher takes {_CHOICES}, got {words!r}{hint}")
    module = _from_file(Path(home)) if home.endswith(".py") else _from_name(home)
    return _function(module, home, name)


def _warn(text):
    console.print(f"warning: {text}", style="yellow")


def _from_file(path):
    """The module that a file is."""
    if not path.is_file():
        raise SetupError(f"--matcher: there is no file {path}")
    _also_look_in(path.parent)
    loader = SourceFileLoader(f"matcher_{path.stem}", str(path))  # a name that no other module has
    module = ModuleType(loader.name)
    module.__file__ = str(path)
    sys.modules[loader.name] = module  # data classes look their module up
    _imported(str(path), lambda: loader.exec_module(module))
    return module


def _from_name(name):
    """The module of a dotted name."""
    _also_look_in(Path())
    if not all(part.isidentifier() for part in name.split(".")):
        raise SetupError(f"--matcher: {name!r} is neither FILE.py nor the name of a module; it takes {_CHOICES}")
    return _imported(name, lambda: importlib.import_module(name))


def _also_look_in(folder):
    place = str(folder.resolve())
    if place not in sys.path:
        sys.path.append(place)  # last, so that no file of the user's hides a package


def _imported(what, work):
    """What importing gives, or a SetupError that says what failed and where."""
    from ..pipeline.pairs import fault_of

    try:
        return work()
    except ModuleNotFoundError as error:
        if error.name and (what == error.name or what.startswith(f"{error.name}.")):
            raise SetupError(f"--matcher: there is no module {error.name} here or among the installed ones") from None
        raise SetupError(f"--matcher: {what} needs the module {error.name}, which is not installed") from error
    except SyntaxError as error:
        raise SetupError(f"--matcher: {error.filename}, line {error.lineno}: {error.msg}") from error
    except (Exception, SystemExit) as error:
        raise SetupError(f"--matcher: {what} cannot be imported: {fault_of(error)}") from error


def _function(module, home, name):
    """A function of a module, or a SetupError that names those there are."""
    found = getattr(module, name, None)
    if callable(found):
        return found
    own = [key for key, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]
    own = [key for key in own if callable(getattr(module, key)) and not key.startswith("_")]
    fault = f"has no function {name}" if found is None else f"has {name}, but it is no function: {type(found).__name__}"
    raise SetupError(f"--matcher: {home} {fault}; it has {', '.join(own) or 'none'}")
