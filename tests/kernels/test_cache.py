"""Machine code is never older than the sources: a chain of kernels in a package of its own, each run in a new process."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from uavcover.kernels import jit

SOURCES = Path(jit.__file__).parent
DEPTH = 4
LINK = """from uavcover.kernels.jit import kernel
from uavcover.kernels.k{below} import value as below


@kernel
def value(x):
    return below(x) * 10 + {digit}
"""
END = """from uavcover.kernels.jit import kernel


@kernel
def value(x):
    return x * 10 + {digit}
"""
PROGRAM = """from uavcover.kernels import jit
from pathlib import Path
from uavcover.kernels.k{top} import value
from uavcover.kernels import k{top} as top
print(value(7), getattr(value, "_cache_hits", None) and sum(value._cache_hits.values()), jit.folder(Path(top.__file__)))
"""


class Chain:
    """Kernels that call each other; the number that comes out shows every one of them."""

    def __init__(self, folder: Path) -> None:
        self.kernels = folder / "uavcover" / "kernels"
        self.kernels.mkdir(parents=True)
        (folder / "uavcover" / "__init__.py").touch()
        for name in ("__init__.py", "jit.py"):
            shutil.copy(SOURCES / name, self.kernels)
        self.digits = list(range(1, DEPTH + 1))
        for link in range(DEPTH):
            self.write(link, self.digits[link])
        self.home = folder / "home"

    def write(self, link: int, digit: int) -> None:
        self.digits[link] = digit
        text = LINK.format(below=link - 1, digit=digit) if link else END.format(digit=digit)
        (self.kernels / f"k{link}.py").write_text(text)

    @property
    def expected(self) -> int:
        return int("7" + "".join(map(str, self.digits)))

    def run(self, **more: str) -> tuple[int, bool, str]:
        """What comes out, whether the top kernel's machine code was there already, and where it is kept."""
        kept = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA_", "PYTHON", "COV_"))}
        environment = {
            **kept, "PYTHONPATH": str(self.kernels.parents[1]), "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self.home), **more,
        }  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-W", "error", "-c", PROGRAM.format(top=DEPTH - 1)],
            env=environment, cwd=self.kernels, capture_output=True, text=True, timeout=600, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        value, hits, folder = done.stdout.split()
        return int(value), hits == "1", folder


pytestmark = [
    pytest.mark.no_cover,
    pytest.mark.skipif(numba.config.DISABLE_JIT, reason="reaches no line here: the compiled run shows all there is"),
]
"""What runs in other processes reaches no line here."""


@pytest.fixture
def chain(tmp_path: Path) -> Chain:
    return Chain(tmp_path)


def test_a_change_in_any_kernel_of_a_chain_is_seen_at_its_top(chain: Chain) -> None:
    """Of the same length and at the same second, so that neither size nor time gives it away."""
    rng = np.random.default_rng(14)
    assert chain.run()[:2] == (chain.expected, False)
    times = {path: path.stat() for path in chain.kernels.glob("*.py")}
    for link in rng.permutation(DEPTH - 1):
        chain.write(int(link), 5 + int(rng.integers(5)))
        for path, before in times.items():
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert chain.run()[:2] == (chain.expected, False), f"after a change in k{link}.py"
    for path in times:
        path.touch()
    assert chain.run()[:2] == (chain.expected, True), "touched without a change: nothing is compiled"


def test_broken_machine_code_is_compiled_anew(chain: Chain) -> None:
    _, _, folder = chain.run()
    for k, path in enumerate(sorted(Path(folder).iterdir())):
        content = path.read_bytes()
        path.write_bytes((b"", content[: len(content) // 2], b"\x80" + content[::-1])[k % 3])
    assert chain.run()[:2] == (chain.expected, False)
    assert chain.run()[:2] == (chain.expected, True)


def test_where_the_sources_cannot_be_written_to_and_where_nothing_can(chain: Chain, tmp_path: Path) -> None:
    (chain.kernels / "__pycache__").write_text("in the way, also of root")
    value, _, folder = chain.run()
    assert value == chain.expected
    assert Path(folder).is_relative_to(chain.home)
    assert chain.run()[:2] == (chain.expected, True)
    shutil.rmtree(chain.home)
    chain.home.write_text("in the way")
    assert chain.run() == (chain.expected, False, "None")
    _, _, folder = chain.run(NUMBA_CACHE_DIR=str(tmp_path / "wanted"))
    assert Path(folder).is_relative_to(tmp_path / "wanted")


def test_interpreted_kernels_keep_nothing(chain: Chain) -> None:
    value, _, _ = chain.run(NUMBA_DISABLE_JIT="1")
    assert value == chain.expected
    assert not list(chain.kernels.glob("__pycache__/kernels/*/*"))


def test_a_change_recompiles_what_depends_on_it_and_nothing_else(chain: Chain) -> None:
    """The link below the top changes: those below it keep their machine code."""
    _, _, folder = chain.run()
    before = {path.name for path in Path(folder).parent.iterdir()}
    chain.write(DEPTH - 2, 9)
    assert chain.run()[:2] == (chain.expected, False)
    new = {path.name.split("-")[0] for path in Path(folder).parent.iterdir() if path.name not in before}
    assert new == {f"k{DEPTH - 2}", f"k{DEPTH - 1}"}


@pytest.mark.parametrize(("module", "name"), [(numba, "__version__"), (np, "__version__"), (numba.config, "OPT")])
def test_the_key_holds_the_compiler_and_its_settings(
    monkeypatch: pytest.MonkeyPatch, module: object, name: str
) -> None:
    before = jit._key(SOURCES / "sight.py")
    monkeypatch.setattr(module, name, "other")
    assert jit._key(SOURCES / "sight.py") != before


def test_the_sources_are_those_that_python_imports() -> None:
    """Read by the syntax tree, which shares nothing with the search for import lines."""
    package = SOURCES.parent
    files = [path for path in package.rglob("*.py") if "from uavcover.kernels.jit import" in path.read_text()]
    assert {path.parent.name for path in files} == {"kernels", "bounds"}
    for file in files:
        naive, ahead = set(), [file]
        while ahead:
            path = ahead.pop()
            if path in naive or not path.is_file():
                continue
            naive.add(path)
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    module = str(node.module) if isinstance(node, ast.ImportFrom) else ""
                    names = [module, *(f"{module}.{alias.name}".strip(".") for alias in node.names)]
                    ahead += [package.parent / f"{name.replace('.', '/')}.py" for name in names]
        assert jit._sources(file) == naive, file.name


def test_the_key_holds_every_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit, "_PACKAGE", tmp_path)
    (tmp_path / "a.py").write_text("from uavcover.b import y\n")
    (tmp_path / "b.py").write_text("y = 2\n")
    (tmp_path / "c.py").write_text("z = 2\n")
    keys = {jit._key(tmp_path / "a.py")}
    for name, content in [("b.py", "y = 4\n"), ("b.py", "y = 4\nx"), ("a.py", "x = 3\n"), ("a.py", "x = 3\ny")]:
        (tmp_path / name).write_text(content)
        keys.add(jit._key(tmp_path / "a.py"))
    (tmp_path / "c.py").unlink()
    assert len(keys | {jit._key(tmp_path / "a.py")}) == 5


def test_old_machine_code_goes(tmp_path: Path) -> None:
    location = tmp_path / "kernels"
    (tmp_path / "kernels-of-before").mkdir()
    for stem in ("a", "b"):
        for age in range(6):
            (location / f"{stem}-{age}").mkdir(parents=True)
            os.utime(location / f"{stem}-{age}", (1000 - age, 1000 - age))
    jit._remove_old(location, "a")
    assert {path.name for path in location.iterdir()} == {"a-0", "a-1", "a-2", *(f"b-{age}" for age in range(6))}
    assert not (tmp_path / "kernels-of-before").exists()
