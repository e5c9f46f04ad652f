"""XDMF files whose grids include the mesh of another, as FEniCS writes them: VTK takes it twice, or ends the process."""

from __future__ import annotations

import re
from copy import deepcopy
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement, parse

_NAMED = re.compile(r"""@Name\s*=\s*["']([^"']+)["']""")
_MESH = ("Topology", "Geometry")


def without_includes(file: Path, folder: Path) -> Path:
    """The file itself, or where grids include parts of others one in the folder: of each time one grid with all arrays.

    Raises
    ------
    ParseError : no XML
    ValueError : grids of several times do not tell them, those of one time have several meshes, or none has an array
    """
    root = parse(file).getroot()
    if not any(element.tag.endswith("}include") for element in root.iter()):
        return file
    grids = [grid for grid in root.iter("Grid") if grid.find("Attribute") is not None]
    states: dict[float, Element] = {}
    for grid in grids:
        mesh, time = _mesh_of(root, grid), _time_of(grid, alone=len(grids) == 1)
        if time not in states:
            states[time] = Element("Grid", Name="state", GridType="Uniform")
            states[time].extend([Element("Time", Value=repr(time)), *mesh])
        elif [_text(part) for part in mesh] != [_text(states[time].find(kind)) for kind in _MESH]:
            raise ValueError(f"the arrays of time {time:g} are on several meshes; write them on one")
        states[time].extend(grid.findall("Attribute"))
    if not states:
        raise ValueError("no grid has an array")
    whole = Element("Xdmf", Version="3.0")
    kinds = {"Name": "states", "GridType": "Collection", "CollectionType": "Temporal"}
    collection = SubElement(SubElement(whole, "Domain"), "Grid", kinds)
    collection.extend([states[time] for time in sorted(states)])
    for item in {id(item): item for item in whole.iter("DataItem")}.values():
        if item.get("Format", "XML").upper() != "XML":
            item.text = f"{file.parent.resolve()}/{(item.text or '').strip()}"
    ElementTree(whole).write(folder / file.name, encoding="utf-8", xml_declaration=True)
    return folder / file.name


def _text(element: Element | None) -> str:
    return "" if element is None else " ".join("".join(element.itertext()).split())


def _time_of(grid: Element, alone: bool) -> float:
    time = grid.find("Time")
    if time is None and not alone:
        raise ValueError("a grid tells no time; write each state with its own")
    return float(time.get("Value", "0")) if time is not None else 0.0


def _mesh_of(root: Element, grid: Element) -> list[Element]:
    """Copies of topology and geometry of a grid: its own, or those of the grid that it names, or of the first."""
    pointer = next((child.get("xpointer", "") for child in grid if child.tag.endswith("}include")), "")
    named = [other for name in _NAMED.findall(pointer) for other in root.iter("Grid") if other.get("Name") == name]
    for place in (grid, *named, root):
        for other in place.iter("Grid"):
            mesh = [part for part in map(other.find, _MESH) if part is not None]
            if len(mesh) == len(_MESH):
                return deepcopy(mesh)
    raise ValueError("no grid has topology and geometry")
