"""What a result depends on besides its case: code, libraries, processor; and the memory that it took."""

import functools
import hashlib
import platform
import subprocess
import threading
from importlib import metadata
from pathlib import Path
from types import TracebackType

import psutil

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "fracture-verify"
LIBRARIES = ("numpy", "scipy", "numba", "scikit-fem", "pypardiso", "mkl", "pandas", "pyvista", "scikit-image")
# What can change a run's numbers and its health record. Judging and drawing are left out: they never ask for a new run.
SOLVING = ("cases", "physics", "numerics", "fem_reference", "mpm", "rigid_block", "verify/health")
SOLVING_MODULES = (
    "verify/runs/running.py", "verify/runs/run_writer.py", "verify/runs/checkpoint.py", "verify/runs/listeners.py",
    "verify/runs/frames.py", "verify/runs/vtk_files.py", "verify/runs/importing.py", "verify/runs/foreign_fields.py",
    "verify/runs/xdmf_files.py", "verify/runs/field_energies.py", "verify/metrics/crack_path.py",
    "verify/metrics/energy_release.py", "verify/metrics/histories.py", "verify/metrics/release.py",
)  # fmt: skip
# What is recorded beside a case from results: it changes none.
RECORDED = ("baseline.csv", "charts/*", "maps/*", "prices.csv", "results/*")


@functools.cache
def code_version() -> str:
    """Package version, with git's description of the working tree when there is one."""
    try:
        version = metadata.version(PACKAGE)
    except metadata.PackageNotFoundError:
        version = "unknown"
    described = _git_description()
    return f"{version}+{described}" if described else version


def _git_description() -> str:
    """The last commit, ``-dirty`` where a file of it has changed that can change a result."""
    if not (ROOT / ".git").exists():
        return ""
    try:
        described = _git("describe", "--always", "--tags")
        others = [f":(exclude)cases/library/*/{name}" for name in RECORDED]
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", ".", *others)
    except (OSError, subprocess.SubprocessError):
        return ""
    return f"{described}-dirty" if changed else described


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip()


@functools.cache
def source_hash() -> str:
    """First 16 hex digits of the SHA-256 of all source files that can change a run's numbers.

    A run is up to date when its case and this are unchanged; a commit to the README keeps it so, an
    uncommitted edit of a solver does not.
    """
    files = [path for room in SOLVING for path in (ROOT / room).rglob("*.py")]
    files += [ROOT / module for module in SOLVING_MODULES]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.relative_to(ROOT).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@functools.cache
def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that take part in a solution; absent ones are left out."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


@functools.cache
def processor_name() -> str:
    """The processor's own name where the system tells it, else its architecture."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def resident_megabytes() -> float:
    """Memory of this process that is in use now [10^6 bytes]."""
    return psutil.Process().memory_info().rss / 1e6


class PeakMemory:
    """Largest resident memory of this process while the context is open, in megabytes (10^6 bytes).

    Sampled by a thread: the system's own high-water mark covers the whole life of the process and would
    give a small run the memory of a large one before it.
    """

    def __init__(self, interval: float = 0.05) -> None:
        self.megabytes = 0.0
        self._interval = interval
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _sample(self) -> None:
        self.megabytes = max(self.megabytes, resident_megabytes())

    def _watch(self) -> None:
        while not self._stop.wait(self._interval):
            self._sample()

    def __enter__(self) -> "PeakMemory":
        self._sample()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._sample()
