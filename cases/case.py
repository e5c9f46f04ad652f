"""A case: what its file holds, at one tier and for one run, and what can be asked of it."""

from __future__ import annotations

import hashlib
import json
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from cases.judging import Check, TierName
from cases.rules import fit_together
from cases.schema import CaseDescription

# Keys that say nothing about what is computed.
_PROSE_AND_JUDGING = {"title", "section", "requirement", "runs", "tiers", "references", "checks", "charts", "maps"}
#: name of the file of a case that has a folder of its own
CASE_FILE = "case.toml"
_NOT_HASHED = _PROSE_AND_JUDGING | {"name", "tier", "run", "change", "folder", "source"}


class Case(CaseDescription):
    """A case at one tier, for one run or for none.

    Attributes
    ----------
    name : of the folder in the library, or of the file
    tier : whose tables were merged
    run : whose change was merged; None for the case as it stands
    change : tables merged over that run's by whoever varies the case
    folder, source : where the file lies, and the file
    """

    name: str
    tier: TierName = "standard"
    run: str | None = None
    change: dict[str, Any] = Field(default_factory=dict)
    folder: Path
    source: Path

    @model_validator(mode="after")
    def _fits_together(self) -> Case:
        # those of the other runs are looked at with them
        checks = [(number, check) for number, check in self.applying_checks() if self.run in (None, check.run)]
        fit_together(self, checks)
        return self

    @property
    def kept_folder(self) -> Path:
        """Of its page, baseline, prices and kept results: its own folder, or one beside a file among those of others."""
        return self.folder if self.source.name == CASE_FILE else self.folder / f"{self.name}.kept"

    def applying_checks(self) -> list[tuple[int, Check]]:
        """Checks of this tier, which may have runs of its own, with their numbers; those of a family taken apart."""
        specs = list(self.run_specs().values())
        applying = [(number, check) for number, check in enumerate(self.checks) if self.tier in check.tiers]
        return [(number, each) for number, check in applying for each in check.each(specs)]

    def _repr_html_(self) -> str:
        """What it is, in a notebook: requirement, outline of the bodies, material, loading, spacing, runs."""
        rows = {
            "requirement": self.requirement,
            "materials": "; ".join(f"{name}: E = {each.young:g}" for name, each in self.materials.items() if each.young),
            "load": f"u = {' → '.join(f'{u:g}' for u in self.load.path)} {self.units.length}" if self.load else "dynamic",
            "spacing": f"{self.mesh.h:g} {self.units.length}, tier {self.tier}",
            "runs": ", ".join(self.expanded_runs()),
        }
        cells = "".join(f"<tr><th>{key}</th><td>{escape(value)}</td></tr>" for key, value in rows.items() if value)
        return f"<p><b>{escape(self.title)}</b> ({escape(self.name)})</p>{self._outlines()}<table>{cells}</table>"

    def _outlines(self) -> str:
        """The bodies' outlines as an SVG element, y upwards."""
        (left, bottom), (right, top) = (np.asarray(corner, dtype=float) for corner in self.bounding_box())
        edge = 0.02 * max(right - left, top - bottom)
        areas = [body.outline() for body in self.bodies.values()]
        shapes = "".join(area.svg(scale_factor=0.5 * edge, fill_color="#dce4ec") for area in areas)
        frame = f"{left - edge:g} {-top - edge:g} {right - left + 2 * edge:g} {top - bottom + 2 * edge:g}"
        return f'<svg width="260" height="200" viewBox="{frame}"><g transform="scale(1,-1)">{shapes}</g></svg>'

    def hash(self, stated: bool = False) -> str:
        """First 16 hexadecimal digits of the SHA-256 of what is computed.

        Equal hashes mean equal computations: prose, references, checks and the other runs do not enter, so
        that results can be judged anew without computing again; files enter with their content.

        stated : of what the file says alone, so that a key that comes to the schema with a default does not change it
        """
        tables = self.model_dump(mode="json", exclude=_NOT_HASHED, exclude_defaults=stated)
        for name, body in self.bodies.items():
            _enter_mesh(tables["bodies"][name], body.mesh, body.group)
        for name, boundary in self.boundaries.items():
            _enter_mesh(tables["boundaries"][name], boundary.mesh, boundary.group)
            if boundary.mesh is None:
                tables["boundaries"][name].pop("mesh", None)
        for number, constraint in enumerate(self.constraints):
            if isinstance(constraint.table, Path):
                rows = constraint.table.read_bytes()
                tables["constraints"][number]["table"] = hashlib.sha256(rows).hexdigest()
        ground = self.dynamics.ground if self.dynamics else None
        if ground and (motion := ground.table or ground.recorded_in(self.folder)):
            tables["dynamics"]["ground"]["table"] = hashlib.sha256(motion.read_bytes()).hexdigest()
        spec = self.run_spec(self.run) if self.run else None
        tables["solver"] = spec.solver if spec else None
        if spec and spec.foreign:
            tables["foreign"] = spec.foreign.checksum()
        return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()[:16]


def _enter_mesh(table: dict[str, Any], mesh: Path | None, group: str | None) -> None:
    """A mesh by its content, wherever it lies; a group that is not asked for is no part of what is computed."""
    if mesh is not None:
        table["mesh"] = hashlib.sha256(mesh.read_bytes()).hexdigest()
    if group is None:
        table.pop("group", None)
