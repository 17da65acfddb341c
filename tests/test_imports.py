"""The arrows between the packages: who may import whom, and what an import may load."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("lavsim", "leaderboard", "agents")

# Who may import whom among our packages. Commands alone also reach the others, and only inside functions.
ALLOWED = {
    "lavsim": {"lavsim"},
    "leaderboard": {"lavsim", "leaderboard", "routes"},
    "agents": {"lavsim", "agents"},
}

# Layers of lavsim, high to low; a module imports its own layer and those below. Names are parts of `lavsim.<name>`.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("__main__", "cli"),
    ("commands",),
    ("sheets",),
    ("bench",),
    ("live",),
    ("dataset", "rerun_export", "export_scene"),
    ("episode", "viewer"),
    ("isolation", "isolation_child", "isolation_guard"),
    ("agent", "agent_runner", "agent_source", "carla_standin", "route_standin", "srunner_standin"),
    ("log",),
    ("simulation",),
    ("scenarios", "sensors"),
    ("traffic", "render"),
    ("world",),
    ("map", "towns"),
    ("carla_types", "drawings", "executor", "geometry", "registry", "messages", "config", "guidance"),
    ("random", "kernel", "kernel_draws", "portable_math", "cache"),
    ("types",),
    ("errors",),
    ("__init__",),
)
LAYER_OF = {name: number for number, names in enumerate(LAYERS) for name in names}


def modules(package: str) -> Iterator[tuple[str, Path]]:
    for path in sorted((ROOT / package).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        yield ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 2 else parts), path


def imports(path: Path, module: str) -> Iterator[tuple[str, bool]]:
    """Dotted names that `path` imports, and whether at its own import (not in a function, not for types)."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    waiting: list[tuple[ast.AST, bool]] = [(tree, True)]
    while waiting:
        node, at_import = waiting.pop()
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, at_import
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            assert node.module is not None
            for alias in node.names:
                yield f"{node.module}.{alias.name}", at_import
        inner = at_import and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            inner = False
        waiting += [(child, inner) for child in ast.iter_child_nodes(node)]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_only_what_lies_below_them(package: str) -> None:
    for module, path in modules(package):
        for name, at_import in imports(path, module):
            top = name.split(".")[0]
            if top in {"tests", *PACKAGES, "routes"} and top not in ALLOWED[package]:
                assert module.startswith("lavsim.commands"), f"{module} imports {name}"
                assert not at_import, f"{module} imports {name} before it is needed"


def test_layers_of_lavsim_point_down() -> None:
    for module, path in modules("lavsim"):
        own = module.split(".")[1]
        assert own in LAYER_OF, f"{module} stands in no layer: enter it in LAYERS"
        for name, at_import in imports(path, module):
            parts = name.split(".")
            if parts[0] == "lavsim" and at_import and len(parts) > 1 and parts[1] in LAYER_OF:
                assert LAYER_OF[parts[1]] >= LAYER_OF[own], f"{module} imports {name}, which lies above it"


@pytest.mark.parametrize("package", PACKAGES)
def test_nobody_imports_torch_before_it_is_needed(package: str) -> None:
    for module, path in modules(package):
        if module.startswith(("agents.lav", "agents.cloning")):
            continue
        for name, at_import in imports(path, module):
            if module == "lavsim.executor" and name == "ray" and not at_import:
                continue
            assert name.split(".")[0] not in {"torch", "lightning", "ray"}, f"{module} imports {name}"


def test_no_import_cycles() -> None:
    graph: dict[str, set[str]] = {}
    known = {module for package in PACKAGES for module, _ in modules(package)}
    for package in PACKAGES:
        for module, path in modules(package):
            targets = set()
            for name, at_import in imports(path, module):
                while name and name not in known:
                    name = name.rpartition(".")[0]
                if at_import and name and name != module:
                    targets.add(name)
            graph[module] = targets
    state: dict[str, int] = {}

    def visit(module: str, trail: tuple[str, ...]) -> None:
        if state.get(module) == 2:
            return
        assert state.get(module) != 1, f"import cycle: {' -> '.join((*trail, module))}"
        state[module] = 1
        for target in sorted(graph[module]):
            visit(target, (*trail, module))
        state[module] = 2

    for module in sorted(graph):
        visit(module, ())


@pytest.mark.parametrize("package", ["lavsim", "leaderboard", "agents", "lavsim.agent", "lavsim.isolation_child"])
def test_importing_a_package_stays_light(package: str) -> None:
    heavy = ("torch", "numba", "matplotlib", "pyarrow", "cv2", "shapely", "scipy")
    code = f"import sys, {package}; print(*[m for m in {heavy!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
