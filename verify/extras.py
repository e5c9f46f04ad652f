"""The optional parts of the installation: which library comes with which, and the sentence where one is missing."""

from __future__ import annotations

from cases.errors import UserError

#: extra of the package -> the modules that come with it
EXTRAS = {
    "solve": ("numba", "skfem", "scipy"),
    "mesh": ("netgen", "meshio"),
    "fields": ("pyvista", "vtkmodules", "vtk", "skimage"),
    "fast": ("pypardiso",),
    "dask": ("dask", "distributed"),
    "easyfea": ("EasyFEA",),
}


class MissingExtraError(UserError):
    """A part of the installation is missing; its text is one sentence with the command that installs it."""


def missing_extra(error: ModuleNotFoundError) -> MissingExtraError | None:
    """The sentence for a module that was not found, None where it belongs to no extra."""
    module = (error.name or "").partition(".")[0]
    for extra, modules in EXTRAS.items():
        if module in modules:
            command = f"pip install 'fracture-verify[{extra}]'"
            return MissingExtraError(f"{module} is not installed, which this needs; install it with {command}.")
    return None
