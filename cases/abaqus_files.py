"""Input files of Abaqus and CalculiX: their nodes, elements and sets, and nothing else of them.

Keywords and the names of element types are the same in capital and small letters. What makes or moves nodes and elements
by itself is refused, since the mesh would be another one without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cases.errors import MeshError

if TYPE_CHECKING:
    import meshio

#: keywords that make or move nodes and elements, or have them in other files
_MAKERS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "INCLUDE", "IMPERFECTION")
#: plane elements by the number of their nodes
_PLANE = {"3": "triangle", "4": "quad", "6": "triangle6", "8": "quad8"}
_PLANE_NAME = re.compile(r"(?:CPS|CPE|M3D|R3D)([3468])(?![0-9])[A-Z]*")
_OTHERS = (
    (re.compile(r"T[23]D2[A-Z]*|R2D2|B[23][13][A-Z]*"), "line"),
    (re.compile(r"T[23]D3[A-Z]*|B[23]2[A-Z]*"), "line3"),
    (re.compile(r"STRI3|S3R?S?"), "triangle"),
    (re.compile(r"STRI65"), "triangle6"),
    (re.compile(r"S4[A-Z]*5?"), "quad"),
    (re.compile(r"S8R5?"), "quad8"),
    (re.compile(r"S9R5"), "quad9"),
)
#: what meshio writes for plane quadrilaterals and lines of three nodes, and what they are
_OF_MESHIO = {"CAX4P": "CPS4", "B33H": "B32H"}
#: nodes of each kind of element
_NODES = {"line": 2, "line3": 3, "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9}

Numbers = dict[int, int]


def read_abaqus(path: Path) -> meshio.Mesh:
    """The mesh with its sets of nodes and elements by name; those of one name are one set.

    Raises
    ------
    MeshError : something in it is no mesh of nodes and elements as they stand there
    UnicodeDecodeError : not UTF-8
    """
    import meshio

    read = _Reader(path)
    text = path.read_text(encoding="utf-8")
    for name, meant in _OF_MESHIO.items() if "written by meshio" in text else ():
        text = text.replace(name, meant)
    for keyword, options, rows in _blocks(text):
        read.block(keyword, options, rows)
    sizes = [len(elements) for _, elements in read.blocks]
    first = np.cumsum([0, *sizes])
    return meshio.Mesh(
        np.array(read.points, dtype=np.float64).reshape(-1, 3),
        [(kind, np.array(elements, dtype=np.int64)) for kind, elements in read.blocks],
        point_sets={name: np.unique(nodes).astype(np.int64) for name, nodes in read.node_sets.named()},
        cell_sets={
            name: [_between(elements, start, start + size) for start, size in zip(first, sizes, strict=False)]
            for name, elements in read.element_sets.named()
        },
    )


def _between(numbers: list[int], start: int, end: int) -> NDArray[np.int64]:
    """Those of the numbers from start to before end, counted from start, each once."""
    all_of_them = np.unique(np.array(numbers, dtype=np.int64))
    return all_of_them[(all_of_them >= start) & (all_of_them < end)] - start


def _blocks(text: str) -> Iterator[tuple[str, dict[str, str], list[list[str]]]]:
    """Keyword, its options and its rows of data, one after the other."""
    keyword, rows = "", list[list[str]]()
    for line in text.splitlines():
        stripped = line.strip()
        if stripped.startswith("**") or not stripped:
            continue
        if stripped.startswith("*"):
            if keyword:
                yield *_options(keyword), rows
            keyword, rows = stripped, []
        elif keyword.endswith(","):
            keyword += stripped
        else:
            rows.append([entry.strip() for entry in stripped.split(",")])
    if keyword:
        yield *_options(keyword), rows


def _options(line: str) -> tuple[str, dict[str, str]]:
    keyword, *rest = (part.strip() for part in line[1:].split(","))
    pairs = (part.partition("=") for part in rest if part)
    return " ".join(keyword.upper().split()), {key.strip().upper(): value.strip() for key, _, value in pairs}


@dataclass
class _Sets:
    """Sets of numbers by names that are the same in capital and small letters; the first spelling is kept.

    of_instance : keys of the sets of the part, whose instance the assembly has; one that the assembly calls the same is
        another set, and that of the part is then named as an assembly names it, "INSTANCE.NAME"
    """

    spelt: dict[str, str] = field(default_factory=dict)
    members: dict[str, list[int]] = field(default_factory=dict)
    of_instance: dict[str, str] = field(default_factory=dict)

    def belong_to(self, instance: str) -> None:
        """What is there are the sets of a part, and what comes those of the assembly with its instance."""
        self.of_instance = dict.fromkeys(self.members, instance)

    def add(self, name: str, numbers: list[int]) -> None:
        """Put numbers into the set of a name."""
        key = name.strip('"').upper()
        if instance := self.of_instance.pop(key, ""):
            full = f"{instance}.{self.spelt.pop(key)}"
            self.spelt[full.upper()], self.members[full.upper()] = full, self.members.pop(key)
        self.spelt.setdefault(key, name.strip('"'))
        self.members.setdefault(key, []).extend(numbers)

    def of(self, name: str) -> list[int] | None:
        """Numbers of the set of a name, which may have that of an instance before it; None where there is none."""
        key = name.strip('"').upper()
        return self.members.get(key, self.members.get(key.rpartition(".")[2]))

    def named(self) -> list[tuple[str, list[int]]]:
        """Names as they were first spelt, and the numbers of each."""
        return [(self.spelt[key], numbers) for key, numbers in self.members.items()]


@dataclass
class _Reader:
    """What has been read of a file.

    blocks : kind of elements, and the places of their nodes in `points`
    seen : keywords so far
    nodes, elements : number in the file -> place in `points`, and in all blocks one after the other; those of an
        assembly, as its points of reference, are counted by themselves
    """

    path: Path
    points: list[list[float]] = field(default_factory=list)
    blocks: list[tuple[str, list[list[int]]]] = field(default_factory=list)
    nodes: Numbers = field(default_factory=dict)
    elements: Numbers = field(default_factory=dict)
    of_assembly: Numbers = field(default_factory=dict)
    node_sets: _Sets = field(default_factory=_Sets)
    element_sets: _Sets = field(default_factory=_Sets)
    seen: list[str] = field(default_factory=list)
    is_assembly: bool = False

    def block(self, keyword: str, options: dict[str, str], rows: list[list[str]]) -> None:
        """Read a keyword with its rows."""
        readers: dict[str, Callable[[dict[str, str], list[list[str]]], None]] = {
            "NODE": self._nodes, "ELEMENT": self._elements, "NSET": self._node_set, "ELSET": self._element_set,
        }  # fmt: skip
        if keyword in _MAKERS or (keyword in ("NODE", "ELEMENT") and "INPUT" in options):
            what = keyword if keyword in _MAKERS else f"{keyword}, INPUT"
            raise self._error(f"has *{what}, which is not read; write all nodes and elements into this file, one by one")
        self._part(keyword, options, rows)
        if keyword in readers:
            try:
                readers[keyword](options, rows)
            except (ValueError, IndexError):
                raise self._error(f"has a line of *{keyword} that holds no numbers; export it again") from None
            except KeyError as option:
                raise self._error(f"has *{keyword} without the option {option.args[0]}; export it again") from None

    def _part(self, keyword: str, options: dict[str, str], rows: list[list[str]]) -> None:
        self.is_assembly = keyword == "ASSEMBLY" or (self.is_assembly and keyword != "END ASSEMBLY")
        twice = keyword in ("PART", "INSTANCE") and keyword in self.seen
        self.seen.append(keyword)
        if twice or (keyword == "INSTANCE" and rows):
            raise self._error("holds instances of parts, whose places cannot be read; write the input file without "
                              "parts and assemblies")  # fmt: skip
        if keyword == "INSTANCE":
            for sets in (self.node_sets, self.element_sets):
                sets.belong_to(options.get("NAME", "part").strip('"'))

    def _nodes(self, options: dict[str, str], rows: list[list[str]]) -> None:
        if options.get("SYSTEM", "R").upper() != "R":
            raise self._error("has nodes in coordinates that are not rectangular (*NODE, SYSTEM); export it in x and y")
        numbers = self.of_assembly if self.is_assembly else self.nodes
        for number, *place in rows:
            numbers[int(number)] = len(self.points)
            self.points.append([float(x.upper().replace("D", "E") or 0.0) for x in [*place, "", "", ""][:3]])
        if "NSET" in options:
            self.node_sets.add(options["NSET"], [numbers[int(row[0])] for row in rows])

    def _elements(self, options: dict[str, str], rows: list[list[str]]) -> None:
        kind = self._kind(options.get("TYPE", ""))
        flat = [int(entry) for row in rows for entry in row if entry]
        size = _NODES[kind] + 1
        if len(flat) % size:
            raise self._error(f"has elements of type {options['TYPE']} with more or fewer than {size - 1} nodes")
        first = sum(len(elements) for _, elements in self.blocks)
        table = [flat[start : start + size] for start in range(0, len(flat), size)]
        if missing := next((n for row in table for n in row[1:] if n not in self.nodes), None):
            raise self._error(f"has no node {missing}, which an element of it names; export it again")
        self.blocks.append((kind, [[self.nodes[n] for n in row[1:]] for row in table]))
        self.elements |= {row[0]: first + place for place, row in enumerate(table)}
        if "ELSET" in options:
            self.element_sets.add(options["ELSET"], list(range(first, first + len(table))))

    def _kind(self, name: str) -> str:
        if plane := _PLANE_NAME.fullmatch(name.upper()):
            return _PLANE[plane[1]]
        for pattern, kind in _OTHERS:
            if pattern.fullmatch(name.upper()):
                return kind
        raise self._error(f"elements of type {name} are not supported; export plane triangles or quadrilaterals alone, "
                          "such as CPE3, CPE4, CPS6 or CPS8")  # fmt: skip

    def _node_set(self, options: dict[str, str], rows: list[list[str]]) -> None:
        known = self.of_assembly if self.is_assembly and "INSTANCE" not in options else self.nodes
        if "ELSET" in options:
            cells = [cell for _, elements in self.blocks for cell in elements]
            chosen = self.element_sets.of(options["ELSET"]) or []
            self.node_sets.add(options["NSET"], [node for element in chosen for node in cells[element]])
            return
        self.node_sets.add(options["NSET"], self._members(rows, options, known, self.node_sets, "node"))

    def _element_set(self, options: dict[str, str], rows: list[list[str]]) -> None:
        members = self._members(rows, options, self.elements, self.element_sets, "element")
        self.element_sets.add(options["ELSET"], members)

    def _members(
        self, rows: list[list[str]], options: dict[str, str], known: Numbers, sets: _Sets, what: str
    ) -> list[int]:
        """Places of what a set lists: numbers, numbers from one to another, or names of other sets."""
        if "GENERATE" in options:
            ranges = [[int(entry) for entry in row if entry] for row in rows]
            numbers = [n for low, high, *step in ranges for n in range(low, high + 1, *step)]
            rows = [[str(n)] for n in numbers if n in known]
        found: list[int] = []
        for entry in (entry for row in rows for entry in row if entry):
            others = [known[int(entry)]] if entry.isdigit() and int(entry) in known else sets.of(entry)
            if others is None:
                raise self._error(f"has a set that names {what} {entry}, which is not there; export it again")
            found += others
        return found

    def _error(self, text: str) -> MeshError:
        return MeshError(f"{self.path}: {text}")
