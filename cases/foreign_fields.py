"""The fields of a result from elsewhere as a case file names them: file, arrays, plane of a cut, unit of lengths."""

from __future__ import annotations

import re
from pathlib import Path

from pydantic import ValidationInfo, field_validator

from cases.errors import BrokenRuleError
from cases.files import existing_file
from cases.table import Table

_CUT = re.compile(r"\s*([xyz])\s*=\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*")


class ForeignFields(Table):
    """Fields on a mesh of any cells, of one state or several.

    Attributes
    ----------
    file : VTU, PVD, VTK, XDMF or Exodus
    phase_field, damage : array of c (1 intact), or of d = 1 - c; found by their usual names without
    displacement, stress : arrays of vectors, and of tensors or of xx, yy, (zz,) xy in the case's unit; likewise
    cut : plane of a three-dimensional result, "z = 0.5" in the file's lengths; its other two axes are x and y of the case
    unit : of the file's lengths, that of the case without
    """

    file: Path
    phase_field: str = ""
    damage: str = ""
    displacement: str = ""
    stress: str = ""
    cut: str = ""
    unit: str = ""

    @property
    def plane(self) -> tuple[int, float] | None:
        """Axis and place of the cut; None without one."""
        found = _CUT.fullmatch(self.cut)
        return ("xyz".index(found[1]), float(found[2])) if found else None

    @field_validator("file")
    @classmethod
    def _is_a_file(cls, path: Path, info: ValidationInfo) -> Path:
        return existing_file(path, info, "a file of fields")

    @field_validator("cut")
    @classmethod
    def _is_a_plane(cls, text: str) -> str:
        if text and not _CUT.fullmatch(text):
            raise BrokenRuleError("is no plane", 'write for instance "z = 0.5"', value=text)
        return text

    @field_validator("damage")
    @classmethod
    def _is_one_of_two(cls, damage: str, info: ValidationInfo) -> str:
        if damage and info.data.get("phase_field"):
            raise BrokenRuleError("stands beside phase_field, which is 1 - d", "keep one of the two", value=damage)
        return damage


def parse_arrays(text: str) -> dict[str, str]:
    """The keys of `ForeignFields` that "damage = d, displacement = U, cut = z = 0.5" gives.

    Raises
    ------
    BrokenRuleError : a part is no entry KEY = NAME, or of an unknown key
    """
    known = [key for key in ForeignFields.model_fields if key != "file"]
    found: dict[str, str] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        key, equals, value = (word.strip() for word in part.partition("="))
        if key not in known or not equals or not value or key in found:
            remedy = f'write entries such as "damage = d, displacement = U", each once, of {", ".join(known)}'
            raise BrokenRuleError("is not understood", remedy, value=part)
        found[key] = value
    return found
