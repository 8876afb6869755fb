"""The house: imports run down its floors, and every name stands once."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
#: From the ground up. A room knows those below it, none beside it and none above it.
FLOORS = (
    ("formats", "errors", "version", "processes"),
    ("vocabulary",),
    ("mechanics", "rover"),
    ("effects",),
    ("models", "telemetry"),
    ("windows", "simulation"),
    ("estimation",),
    ("comparison",),
    ("diagnosis",),
    ("improvement",),
    ("presentation",),
    ("run",),
    ("batch", "stream", "views"),
    ("api",),
    ("terrain_cli",),
    ("commands",),
    ("app",),
    ("__main__",),
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
#: Named after what stands elsewhere: the verbs of the command line, and what both packages must have.
COMMANDS = "terrain_cli.commands."
TWICE = {"errors"}


def read(root=ROOT):
    """Return the syntax tree of every module, by name."""
    trees = {}
    for top in ("formats", "terrain_cli"):
        for path in sorted((root / top).rglob("*.py")):
            name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
            trees[name] = ast.parse(path.read_text("utf-8"))
    return trees


def imports(trees):
    """Yield module, imported module and line; those for annotations only count too."""
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                whole = [f"{node.module}.{alias.name}" for alias in node.names]
                names = [name if name in trees else node.module for name in whole]
            else:
                continue
            yield from ((module, name, node.lineno) for name in names if name in trees and name != module)


def room(module):
    top, *rest = module.split(".")
    return rest[0] if rest and top == "terrain_cli" else top


def folder(module, trees):
    """Return the folder of a module; a package is one itself."""
    inside = any(name.startswith(module + ".") for name in trees)
    return module if inside else module.rpartition(".")[0]


def circle(arrows):
    """Return the members of a circle, or nothing."""
    graph = defaultdict(set)
    for one, other in arrows:
        graph[one].add(other)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


@cache
def house():
    """Return the trees of this house: read in the one worker that has these tests."""
    return read()


def test_every_room_has_a_floor():
    assert {room(module) for module in house()} == FLOOR.keys()


def test_imports_run_down():
    wrong = [
        f"{module}, line {line}: {room(module)} must not know {room(name)}: import {name}"
        for module, name, line in imports(house())
        if room(module) != room(name) and FLOOR[room(module)] <= FLOOR[room(name)]
    ]
    assert not wrong, "\n".join(wrong)


def test_no_circle_of_files():
    assert not circle((module, name) for module, name, _ in imports(house()))


def test_no_circle_of_folders():
    """A folder and the one it lies in are one place."""
    arrows = {(folder(module, house()), folder(name, house())) for module, name, _ in imports(house())}
    assert not circle(
        (one, other)
        for one, other in arrows
        if not f"{one}.".startswith(f"{other}.") and not f"{other}.".startswith(f"{one}.")
    )


def test_a_circle_is_found():
    trees = {
        "formats": ast.parse(""),
        "formats.a": ast.parse("if TYPE_CHECKING:\n    from formats.b import B"),
        "formats.b": ast.parse("def f():\n    from formats import a"),
    }
    assert set(circle((module, name) for module, name, _ in imports(trees))) == {"formats.a", "formats.b"}


def test_no_module_name_stands_twice():
    places = defaultdict(list)
    for module in house():
        if not module.startswith(COMMANDS):
            places[module.rpartition(".")[2]].append(module)
    assert not {name: where for name, where in places.items() if len(where) > 1 and name not in TWICE}


def test_no_public_class_name_stands_twice():
    places = defaultdict(list)
    for module, tree in house().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    assert not {name: where for name, where in places.items() if len(where) > 1}


#: Names that told a stranger nothing.
RIDDLES = {
    *("against", "ahead", "astray", "beside", "bounded", "cells", "clean", "complete", "expected", "feeds"),
    *("health", "inputs", "keeper", "leaves", "leftover", "margins", "merits", "misfit", "needs", "parts"),
    *("pieces", "quiet", "reaches", "refine", "solved"),
}


def test_no_module_is_a_riddle():
    assert not {module for module in house() if module.rpartition(".")[2] in RIDDLES}


def fields(node):
    """Return the fields of a dataclass that may be given by their place."""
    found = []
    for one in node.body:
        if isinstance(one, ast.AnnAssign):
            if ast.unparse(one.annotation) == "KW_ONLY":
                break
            if "ClassVar" not in ast.unparse(one.annotation) and "init=False" not in ast.unparse(one):
                found.append(one.target.id)
    return found


def test_large_dataclasses_are_given_by_keyword():
    wrong = []
    for module, tree in house().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                said = " ".join(ast.unparse(decorator) for decorator in node.decorator_list)
                if "dataclass" in said and "kw_only=True" not in said and len(fields(node)) > 5:
                    wrong.append(f"{module}.{node.name}")
    assert not wrong


def test_no_file_is_long():
    files = [*ROOT.glob("formats/**/*.py"), *ROOT.glob("terrain_cli/**/*.py")]
    assert not {path.name for path in files if len(path.read_text("utf-8").splitlines()) > 400}


def test_every_path_in_contributing_is_there():
    named = set(re.findall(r"`([\w./]+/[\w./]*)`", (ROOT / "CONTRIBUTING.md").read_text("utf-8")))
    assert len(named) > 30
    assert not {
        path for path in named if not any((root / path).exists() for root in (ROOT, ROOT / "terrain_cli"))
    }


def test_every_function_in_contributing_is_there():
    """`room/module.py` (`function`, then `other`)."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8").partition("## Glossary")[0]
    named = [
        (path, name)
        for path, names in re.findall(r"`([\w/]+\.py)` \((`\w+`(?:,(?: then)? `\w+`)*)\)", text)
        for name in re.findall(r"\w+", names.replace("then", ""))
    ]
    assert len(named) > 15
    for path, name in named:
        assert f"\ndef {name}(" in (ROOT / "terrain_cli" / path).read_text("utf-8"), name


def test_packages_name_only_modules_that_are_there():
    stale = set()
    for path in ROOT.glob("terrain_cli/*/**/__init__.py"):
        said = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
        named = re.findall(r"`([a-z]+(?:_[a-z]+)+)`|^ +(\w+)\.py ", said, re.MULTILINE)
        stale |= {
            f"{path.parent.name}: {one}" for pair in named for one in pair if one and not _is_module(one)
        }
    assert not stale


def _is_module(name):
    return any(module.rpartition(".")[2] == name for module in house())


def test_no_file_holds_a_merge_that_was_not_settled():
    files = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "man").glob("*.1")]
    files += [path for top in ("tests", "benchmarks") for path in (ROOT / top).rglob("*.toml")]
    assert len(files) > 40
    open_ones = [path.name for path in files if re.search(r"(?m)^(<{7}|>{7}) ", path.read_text("utf-8"))]
    assert open_ones == []
