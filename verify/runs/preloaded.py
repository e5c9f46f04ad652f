"""Imported once by the process from which runs are forked: all that a run imports, and the identity of that code."""

import scipy.signal  # noqa: F401

import fem_reference  # noqa: F401
import mpm  # noqa: F401
import verify.metrics.crack_path
import verify.metrics.registry
import verify.runs.vtk_files  # noqa: F401
from verify.runs.provenance import code_version, source_hash

# kept by the functions themselves: a file edited while runs go on must not change what their folders say of the code
source_hash()
code_version()
