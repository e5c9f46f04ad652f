"""The splits of the elastic energy that a material can name: each file of `physics/splits` is one.

Their names are read off the files, so that the schema knows a new one without importing any law.
"""

from __future__ import annotations

from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from cases.errors import BrokenRuleError


def _names_of_laws() -> tuple[str, ...]:
    found = find_spec("physics")
    assert found is not None and found.submodule_search_locations is not None
    return tuple(sorted(file.name for file in iter_modules(f"{p}/splits" for p in found.submodule_search_locations)))


SPLITS = _names_of_laws()
#: those that act on C^(1/2) strain whatever the stiffness C, in quasi-static cases
ROOTED_SPLITS = ("orthogonal",)
#: those that know a free strain across the plane
PLANE_STRESS_SPLITS = ("spectral_plane_stress",)
#: those for which C may have a direction
ANISOTROPIC_SPLITS = ("none", *ROOTED_SPLITS)


def _known(name: Any) -> Any:
    if name not in SPLITS:
        *first, last = map(repr, SPLITS)
        raise BrokenRuleError("is not one of the choices", f"choose {', '.join(first)} or {last}", value=name)
    return name


SplitName = Annotated[str, BeforeValidator(_known), WithJsonSchema({"type": "string", "enum": list(SPLITS)})]
