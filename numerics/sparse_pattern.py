"""Fixed sparse patterns: the matrix of a discretisation is gathered into known positions.

A discretisation computes packed local matrices (the upper half, row by row) cell by cell. Each stored entry
of the global matrix then sums its contributions in a fixed order, so that the result does not depend on the
number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from numba import njit, prange
from numpy.typing import NDArray


class LocalSystems(NamedTuple):
    """Linear systems of cells with k unknowns, to be filled by compiled loops.

    matrices : (n_cells, k (k + 1) / 2) upper halves, row by row. vectors : (n_cells, k) right sides or forces.
    """

    matrices: NDArray
    vectors: NDArray

    @classmethod
    def empty(cls, n_cells: int, k: int) -> LocalSystems:
        """Room for the systems of ``n_cells`` cells."""
        return cls(np.empty((n_cells, k * (k + 1) // 2)), np.empty((n_cells, k)))

    @property
    def without_matrices(self) -> LocalSystems:
        """The same vectors, with matrices of no cells."""
        return self._replace(matrices=self.matrices[:0])


class SymmetricPattern:
    """Upper half of a symmetric sparse matrix, in CSR with sorted rows and every diagonal entry stored.

    Parameters
    ----------
    equations : (n_cells, k) equation number of each local unknown; negative means eliminated. Unknowns that
        share an equation number are tied.
    size : number of equations.
    extra : (m, 2) further pairs of equations that can couple, for values added by ``positions``.
    """

    def __init__(self, equations: NDArray, size: int, extra: NDArray | None = None) -> None:
        self.size = size
        first, second = np.triu_indices(equations.shape[1])
        rows, columns = equations[:, first], equations[:, second]
        slots = np.arange(rows.size, dtype=np.int64).reshape(rows.shape)
        kept = (rows >= 0) & (columns >= 0)
        # two different unknowns tied to one equation meet on the diagonal twice: K_ij + K_ji
        twice = kept & (rows == columns) & (first != second)
        keys = np.concatenate([_key(rows, columns, kept, size), _key(rows, columns, twice, size)])
        sources = np.concatenate([slots[kept], slots[twice]])
        diagonal = np.arange(size, dtype=np.int64) * (size + 1)
        order = np.argsort(keys, kind="stable")
        keys, self._sources = keys[order], sources[order].astype(np.int32)
        entries = np.union1d(keys, diagonal)
        if extra is not None:
            entries = np.union1d(entries, _key(extra[:, 0], extra[:, 1], np.full(len(extra), True), size))
        self._entries = entries
        self._starts = np.searchsorted(keys, np.append(entries, np.int64(size) * size)).astype(np.int32)
        entry_rows, self.indices = np.divmod(entries, size)
        self.indices = self.indices.astype(np.int32)
        self.indptr = np.searchsorted(entry_rows, np.arange(size + 1)).astype(np.int32)
        self.diagonal = self.indptr[:-1]

    def gather(self, local: NDArray) -> NDArray:
        """Values (nnz,) of the stored entries from packed local matrices (n_cells, k (k + 1) / 2)."""
        values = np.empty(len(self.indices))
        _gather(self._starts, self._sources, local.reshape(-1), values)
        return values

    def positions(self, rows: NDArray, columns: NDArray) -> NDArray:
        """Where the entries (rows, columns) of the upper or lower half are stored."""
        return np.searchsorted(self._entries, _key(rows, columns, np.full(rows.shape, True), self.size))

    def mirror(self) -> tuple[NDArray, NDArray, NDArray]:
        """Both halves: indptr, indices, and for each entry its place among the stored ones."""
        places = sparse.csr_matrix((np.arange(1, len(self.indices) + 1), self.indices, self.indptr))
        both = (places + sparse.triu(places, 1).T).tocsr()
        both.sort_indices()
        return both.indptr, both.indices, both.data - 1

    def upper(self, values: NDArray) -> sparse.csr_matrix:
        """The stored upper half as a scipy matrix."""
        return sparse.csr_matrix((values, self.indices, self.indptr), shape=(self.size, self.size))

    def full(self, values: NDArray) -> sparse.csr_matrix:
        """Both halves as a scipy matrix."""
        upper = self.upper(values)
        return (upper + sparse.triu(upper, 1).T).tocsr()


class RowPattern:
    """A symmetric matrix kept as rows with a fixed number of entries.

    neighbours : (n, s) column of each entry, ascending, n for none.
    """

    def __init__(self, neighbours: NDArray) -> None:
        self.size = len(neighbours)
        self._neighbours = neighbours

    def upper(self, values: NDArray) -> sparse.csr_matrix:
        """The upper half of entries (n, s) as a scipy matrix."""
        return self._kept(values, np.arange(self.size)[:, None])

    def full(self, values: NDArray) -> sparse.csr_matrix:
        """Both halves as a scipy matrix."""
        return self._kept(values, 0)

    def _kept(self, values: NDArray, first: NDArray | int) -> sparse.csr_matrix:
        kept = (self._neighbours >= first) & (self._neighbours < self.size)
        indptr = np.append(0, np.cumsum(kept.sum(axis=1))).astype(np.int32)
        return sparse.csr_matrix((values[kept], self._neighbours[kept], indptr), shape=(self.size, self.size))


def _key(rows: NDArray, columns: NDArray, kept: NDArray, size: int) -> NDArray:
    low, high = np.minimum(rows[kept], columns[kept]), np.maximum(rows[kept], columns[kept])
    return low.astype(np.int64) * size + high


@njit(cache=True, parallel=True)
def _gather(starts, sources, local, values):
    for entry in prange(values.size):
        total = 0.0
        for k in range(starts[entry], starts[entry + 1]):
            total += local[sources[k]]
        values[entry] = total


def gather_vector(equations: NDArray, local: NDArray, size: int) -> NDArray:
    """Sum local vectors (n_cells, k) into a global one (size,); negative equation numbers are dropped."""
    total = np.zeros(size)
    _add_up(equations.reshape(-1), local.reshape(-1), total)
    return total


@njit(cache=True)
def _add_up(equations, local, total):
    for k in range(equations.size):
        if equations[k] >= 0:
            total[equations[k]] += local[k]
