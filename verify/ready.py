"""Imported once by the process from which runs are forked: the solvers, and the identity of the code just imported."""

import fem_reference  # noqa: F401
import mpm  # noqa: F401
from verify.provenance import code_version, source_hash

# kept by the functions themselves: a file edited while runs go on must not change what their folders say of the code
source_hash()
code_version()
