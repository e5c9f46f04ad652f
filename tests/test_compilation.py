"""Compilation is timed apart, and kept for as long as the code is the same."""

import os
import runpy
import shutil
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from numba import njit
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock

from mpm.explicit.stresses import elastic_stress
from numerics.compilation import compilation, compile_without_cache_where_it_fails
from physics import kernel_cache
from physics.kernel_cache import fingerprint


def test_compiling_is_counted_and_work_is_not() -> None:
    @njit
    def inner(x):
        return x + 1.0

    @njit
    def outer(x):
        return inner(x) * 2.0

    started = time.perf_counter()
    with compilation() as spent:
        outer(1.0)
    whole = time.perf_counter() - started
    assert 0.01 < spent.wall <= whole and spent.processor > 0.0
    before = spent.wall
    with compilation() as again:
        outer(2.0)
        time.sleep(0.01)
    assert again.wall == 0.0 and spent.wall == before


def test_the_elastic_stress_takes_no_liberties_whichever_loop_compiles_it_first() -> None:
    @njit(fastmath={"contract"})
    def free(strain):
        return elastic_stress(strain, strain, strain, strain, strain)

    free(np.float32(1.0))  # numbers that no other loop has compiled it for
    compiled = elastic_stress.inspect_llvm().items()
    found = [text for types, text in compiled if str(types[0]) == "float32"]
    assert found and not any(" contract " in text for text in found)


def test_kernels_are_kept_under_the_text_of_all_code_that_may_be_in_them(tmp_path, monkeypatch) -> None:
    root = Path(kernel_cache.__file__).parents[1]
    for package in ("physics", "mpm"):
        shutil.copytree(root / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    before = fingerprint(tmp_path)
    assert before == fingerprint(tmp_path) != fingerprint(root)
    with (tmp_path / "physics/splits/none.py").open("a", encoding="utf-8") as file:
        file.write("# a law that changed\n")
    assert fingerprint(tmp_path) != before
    monkeypatch.setattr(kernel_cache, "user_cache", lambda: tmp_path / "cache")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    for given, kept in (("", tmp_path / "cache" / fingerprint(root)), ("/my/own", "/my/own")):
        monkeypatch.setenv(kernel_cache.VARIABLE, given)
        kernel_cache.keep_kernels()
        assert os.environ[kernel_cache.VARIABLE] == str(kept)


def test_a_folder_that_cannot_be_written_is_no_reason_to_stop(tmp_path, monkeypatch) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    monkeypatch.setattr(kernel_cache, "user_cache", lambda: tmp_path / "file")
    monkeypatch.setenv(kernel_cache.VARIABLE, "")
    kernel_cache.keep_kernels()
    assert not os.environ[kernel_cache.VARIABLE]


def test_loading_what_was_compiled_before_is_counted_as_compiling() -> None:
    """Numba holds the compiler's lock for both; the first load of a process takes most of a second."""
    with compilation() as spent, global_compiler_lock:
        time.sleep(0.02)
    assert spent.wall >= 0.02


@pytest.mark.parametrize("damage", ["cut kernel", "cut index", "full disk"])
def test_a_kept_kernel_that_cannot_be_read_or_written_is_compiled_again(tmp_path, monkeypatch, damage) -> None:
    module = tmp_path / "doubling.py"
    module.write_text("from numba import njit\n\n\n@njit(cache=True)\ndef double(x): return 2 * x\n", encoding="utf-8")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    compile_without_cache_where_it_fails()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def double(x: float) -> float:
        return runpy.run_path(str(module))["double"](x)

    assert double(1.0) == 2.0
    if damage == "full disk":
        monkeypatch.setattr(IndexDataCacheFile, "_dump", full)
        assert double(3) == 6
        monkeypatch.undo()
        monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    else:
        for file in (tmp_path / "kept").rglob("*.nbc" if damage == "cut kernel" else "*.nbi"):
            os.truncate(file, 100 if damage == "cut kernel" else 0)
        assert double(1.0) == 2.0
    assert double(1.0) == 2.0
    assert [file.stat().st_size > 100 for file in (tmp_path / "kept").rglob("*.nb[ic]")].count(True) >= 2
