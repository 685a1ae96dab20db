"""What starting costs beside `import numpy`, and which BLAS the command asks for."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

import struck
from struck.__main__ import blas_kernels

ZEN_5 = """processor\t: 0
vendor_id\t: AuthenticAMD
cpu family\t: 26
model\t\t: 2
model name\t: AMD EPYC 9R45
flags\t\t: fpu sse2 avx2 avx512f avx512dq avx512vl

processor\t: 1
vendor_id\t: AuthenticAMD
cpu family\t: 26
flags\t\t: fpu
"""


def seconds(program: str) -> float:
    begun = time.perf_counter()
    subprocess.run([sys.executable, "-c", program], check=True)
    return time.perf_counter() - begun


def test_importing_costs_at_most_twice_what_numpy_costs() -> None:
    """The least of several turns: whatever else the machine does only adds."""
    turns = [(seconds("import struck"), seconds("import numpy")) for _ in range(5)]
    ours, numpy = (min(column) for column in zip(*turns, strict=True))
    assert ours <= 2 * numpy


def test_a_public_name_is_imported_when_it_is_used() -> None:
    program = (
        "import sys, struck; before = 'numpy' in sys.modules; struck.Material; "
        "print(before, 'numpy' in sys.modules, 'struck.analysis.analysis' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "True", "False"]


@pytest.mark.prove
def test_each_public_name_is_there_first_of_all() -> None:
    program = f"""if True:
        import importlib, sys
        for name in {struck.__all__!r}:
            for module in [each for each in sys.modules if each.partition(".")[0] == "struck"]:
                del sys.modules[module]
            fresh = importlib.import_module("struck")
            assert name in dir(fresh)
            getattr(fresh, name)
    """
    subprocess.run([sys.executable, "-W", "error", "-c", program], check=True)


def test_names_are_their_modules_own() -> None:
    from struck.model.material import Material
    from struck.solids import Tube

    assert struck.Material is Material
    assert struck.solids.Tube is Tube
    assert struck.errors.MeshError is struck.errors.MeshError
    steel = struck.Material.named("steel")
    assert pickle.loads(pickle.dumps(steel)) == steel  # noqa: S301 - our own bytes
    with pytest.raises(AttributeError, match=r"it is struck\.solids\.bell"):
        _ = struck.bell


def test_zen_5_gets_kernels_with_avx_512() -> None:
    assert blas_kernels(ZEN_5, {}) == "SkylakeX"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("family\t: 26", "family\t: 25"),
        ("avx512f ", ""),
        ("AuthenticAMD", "GenuineIntel"),
        (ZEN_5, ""),
        (ZEN_5, "no: such\nformat"),
    ],
)
def test_other_processors_are_left_alone(old: str, new: str) -> None:
    assert blas_kernels(ZEN_5.replace(old, new), {}) is None


@pytest.mark.parametrize("chosen", ["", "Haswell"])
def test_what_a_person_has_set_stays(chosen: str) -> None:
    assert blas_kernels(ZEN_5, {"OPENBLAS_CORETYPE": chosen}) is None


@pytest.mark.prove
def test_importing_never_changes_the_environment() -> None:
    program = (
        "import os; before = dict(os.environ); import struck; struck.analyze; "
        "assert dict(os.environ) == before"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_command_starts_as_a_module(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "struck", "--help"],
        cwd=tmp_path,
        env={**os.environ, "OPENBLAS_CORETYPE": "Haswell"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "analyze" in done.stdout
