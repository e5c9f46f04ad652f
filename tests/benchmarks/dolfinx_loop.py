"""A staggered loop on dolfinx for `dolfinx_staggered.py`, which starts it with a Python that has dolfinx 0.5.

    python3 tests/benchmarks/dolfinx_loop.py problem.npz result.json

What the reference solves, written in UFL: displacement by Newton's method with the spectral split in plane strain, then
the phase field on the history of the tensile energy; four Gauss points a cell, MUMPS for both systems.
"""

import json
import sys
import time

import basix
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from petsc4py import PETSc

QUADRATURE = {"quadrature_degree": 2, "quadrature_scheme": "default"}
#: as fast as the compiler of the forms makes them
COMPILED = {"jit_params": {"cffi_extra_compile_args": ["-O3", "-march=native", "-ffast-math"]}}
#: keeps the principal strains differentiable where they are equal
SMALLEST = 1e-24
LARGEST_NEWTON = 20


class System:
    """A matrix with its factors, and a right side; LU by MUMPS, whose analysis is kept."""

    def __init__(self, bilinear, linear, conditions, kind: str) -> None:
        self.bilinear, self.linear = fem.form(bilinear, **COMPILED), fem.form(linear, **COMPILED)
        self.conditions = conditions
        self.matrix = fem.petsc.create_matrix(self.bilinear)
        self.vector = fem.petsc.create_vector(self.linear)
        self.matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.solver = PETSc.KSP().create(MPI.COMM_SELF)
        self.solver.setOperators(self.matrix)
        self.solver.setType("preonly")
        self.solver.getPC().setType(kind)
        self.solver.getPC().setFactorSolverType("mumps")

    def assemble_vector(self) -> PETSc.Vec:
        with self.vector.localForm() as local:
            local.set(0.0)
        fem.petsc.assemble_vector(self.vector, self.linear)
        return self.vector

    def solve(self, solution: PETSc.Vec) -> None:
        self.matrix.zeroEntries()
        fem.petsc.assemble_matrix(self.matrix, self.bilinear, self.conditions)
        self.matrix.assemble()
        self.solver.solve(self.vector, solution)


class Plate:
    """The plate of the problem: bottom held, top lifted."""

    def __init__(self, given: dict) -> None:
        self.given = given
        coordinates, cells = given["nodes"], given["cells"][:, [0, 1, 3, 2]].astype(np.int64)
        shape = ufl.Mesh(ufl.VectorElement("Lagrange", ufl.Cell("quadrilateral", geometric_dimension=2), 1))
        self.mesh = mesh.create_mesh(MPI.COMM_SELF, cells, coordinates, shape)
        space = fem.VectorFunctionSpace(self.mesh, ("Lagrange", 1))
        scalars = fem.FunctionSpace(self.mesh, ("Lagrange", 1))
        points = ufl.FiniteElement("Quadrature", self.mesh.ufl_cell(), degree=2, quad_scheme="default")
        at_points = fem.FunctionSpace(self.mesh, points)
        self.u, self.du, self.c, self.history = (fem.Function(each) for each in (space, space, scalars, at_points))
        self.c.x.array[:] = 1.0
        self.committed = self.history.x.array.copy()
        self._equations(space, scalars, at_points)

    def _equations(self, space, scalars, at_points) -> None:
        given, dx = self.given, ufl.Measure("dx", domain=self.mesh, metadata=QUADRATURE)
        y = space.tabulate_dof_coordinates()[:, 1]
        self.top, self.bottom = np.flatnonzero(np.isclose(y, 1.0)), np.flatnonzero(np.isclose(y, 0.0))
        held = np.zeros(2)
        upper = fem.locate_dofs_topological(space.sub(1), 1, self._edge(1.0))
        conditions = [
            fem.dirichletbc(held, fem.locate_dofs_topological(space, 1, self._edge(0.0)), space),
            fem.dirichletbc(PETSc.ScalarType(0.0), upper, space.sub(1)),
        ]
        tensile, rest = self._energies()
        total = ((self.c**2 + given["residual_stiffness"]) * tensile + rest) * given["thickness"] * dx
        places, _ = basix.make_quadrature(basix.CellType.quadrilateral, QUADRATURE["quadrature_degree"])
        self.tensile = fem.Expression(tensile, places, **COMPILED)
        self.points, self.cells = at_points.dofmap.list.array, np.arange(len(given["cells"]), dtype=np.int32)
        test, trial = ufl.TestFunction(space), ufl.TrialFunction(space)
        residual = ufl.derivative(total, self.u, test)
        self.equilibrium = System(ufl.derivative(residual, self.u, trial), residual, conditions, "lu")
        self.held = np.unique(np.concatenate([2 * self.bottom, 2 * self.bottom + 1, 2 * self.top + 1]))
        toughness, length = given["toughness"], given["length_scale"]
        test, trial = ufl.TestFunction(scalars), ufl.TrialFunction(scalars)
        driven = (2.0 * self.history + toughness / (2.0 * length)) * trial * test
        spread = 2.0 * toughness * length * ufl.dot(ufl.grad(trial), ufl.grad(test))
        self.fracture = System((driven + spread) * dx, toughness / (2.0 * length) * test * dx, [], "cholesky")

    def _edge(self, y: float):
        return mesh.locate_entities_boundary(self.mesh, 1, lambda x: np.isclose(x[1], y))

    def _energies(self):
        """Tensile and compressive energy per volume of the spectral split, plane strain."""
        young, poisson = self.given["young"], self.given["poisson"]
        shear, lame = young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
        strain = ufl.sym(ufl.grad(self.u))
        mean, half = ufl.tr(strain) / 2.0, (strain[0, 0] - strain[1, 1]) / 2.0
        radius = ufl.sqrt(half**2 + strain[0, 1] ** 2 + SMALLEST)

        def energy(sign: float):
            part = [(value + sign * abs(value)) / 2.0 for value in (2.0 * mean, mean + radius, mean - radius)]
            return lame / 2.0 * part[0] ** 2 + shear * (part[1] ** 2 + part[2] ** 2)

        return energy(1.0), energy(-1.0)

    def balance(self) -> int:
        """Newton's method from the displacement as it is; how many solutions it took."""
        for count in range(LARGEST_NEWTON):
            residual = self.equilibrium.assemble_vector()
            forces = residual.array
            scale = np.linalg.norm(forces[self.held])
            forces[self.held] = 0.0
            if count and np.linalg.norm(forces) <= self.given["residual_tolerance"] * scale:
                return count
            residual.scale(-1.0)
            self.equilibrium.solve(self.du.vector)
            self.u.vector.axpy(1.0, self.du.vector)
        raise SystemExit("Newton's method did not converge")

    def iterate(self) -> int:
        """One staggered iteration; how many solutions for the displacement it took."""
        newton = self.balance()
        energy = self.tensile.eval(self.cells).ravel()
        self.history.x.array[self.points] = np.maximum(self.committed[self.points], energy)
        self.fracture.assemble_vector()
        self.fracture.solve(self.c.vector)
        return newton

    def reaction(self) -> float:
        """Force on the top."""
        return float(self.equilibrium.assemble_vector().array[2 * self.top + 1].sum())

    def run(self) -> list[dict]:
        rows = []
        for load in self.given["loads"]:
            self.u.x.array[2 * self.top + 1] = load
            started = time.process_time()
            newton = sum(self.iterate() for _ in range(self.given["iterations"]))
            seconds = time.process_time() - started
            self.committed = self.history.x.array.copy()
            rows.append({"u": load, "F": self.reaction(), "seconds": seconds, "newton": newton})
        return rows


if __name__ == "__main__":
    with np.load(sys.argv[1], allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    scalars = {name: value.item() for name, value in arrays.items() if value.ndim == 0}
    plate = Plate({**arrays, **scalars, "loads": arrays["loads"].tolist()})
    plate_rows = plate.run()
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(plate_rows, file)
