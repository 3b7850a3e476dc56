"""Type stubs, and what they are stubs of."""

import ast
import inspect
import pathlib
import shutil
import subprocess
import sys

import pytest

import arlequin
from arlequin import _native

PACKAGE = pathlib.Path(arlequin.__file__).parent
STUBS = ast.parse((PACKAGE / "_native.pyi").read_text())


def parameters(function):
    a = function.args
    names = [x.arg for x in a.posonlyargs + a.args]
    names += [f"*{a.vararg.arg}"] if a.vararg else []
    return names + [x.arg for x in a.kwonlyargs]


def found(thing):
    signature = inspect.signature(thing).parameters.values()
    return [f"*{p.name}" if p.kind is p.VAR_POSITIONAL else p.name for p in signature]


def test_stubs_have_every_name_and_every_parameter():
    known = {n.name: n for n in STUBS.body if isinstance(n, (ast.ClassDef, ast.FunctionDef))}
    names = {n for n in dir(_native) if not n.startswith("__")}
    assert names == set(known), names ^ set(known)
    for name, node in known.items():
        thing = getattr(_native, name)
        if isinstance(node, ast.FunctionDef):
            assert found(thing) == parameters(node), name
            continue
        inner = {n.name: n for n in node.body if isinstance(n, ast.FunctionDef)}
        public = {n for n in vars(thing) if not n.startswith("__")}
        assert public == {n for n in inner if n != "__new__"}, (name, public ^ set(inner))
        for method, stub in inner.items():
            if method == "__new__":
                assert found(thing) == parameters(stub)[1:], name
            elif not any(isinstance(d, ast.Name) and d.id == "property" for d in stub.decorator_list):
                assert found(getattr(thing, method)) == parameters(stub), (name, method)


def test_everything_public_says_what_it_is():
    for name in arlequin.__all__:
        thing = getattr(arlequin, name)
        assert name == "__version__" or (thing.__doc__ or "").strip(), name
        if not inspect.isclass(thing) or issubclass(thing, dict):
            continue
        for method, what in vars(thing).items():
            if not method.startswith("_") and (callable(what) or isinstance(what, (property, staticmethod))):
                assert (getattr(thing, method).__doc__ or "").strip(), f"{name}.{method}"


def test_types_of_the_package_are_right(tmp_path):
    pytest.importorskip("mypy", reason="mypy is not installed")
    # Beside no other package: mypy takes those for a part of what it is to check.
    shutil.copytree(PACKAGE, tmp_path / "arlequin", ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    # PyVista has thousands of types, of which the package names none.
    (tmp_path / "mypy.ini").write_text("[mypy]\n[mypy-pyvista.*]\nfollow_imports = skip\n")
    call = [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "arlequin"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    # What the documentation writes.
    (tmp_path / "user.py").write_text(
        "import arlequin as aq\n"
        'run = aq.run("bar.toml", **{"time.end": 1e-4})\n'
        'scene = aq.Scene("bar.toml", **{"time.end": 1e-4}).changed(**{"model.bar.spacing": 0.1})\n'
        "tip: float = float(scene.run(progress=True).probes['tip'].u[-1])\n"
    )
    done = subprocess.run([*call[:-1], "user.py"], capture_output=True, text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
