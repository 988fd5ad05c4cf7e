"""Solves the symmetric block systems that remain after landmarks are eliminated."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from navcore.geometry import FloatArray

DENSE_LIMIT = 40
"""Key frames up to which the dense factorization is always the faster one."""
DENSE_SHARE = 0.5
"""Share of blocks that are filled above which it is faster for more key frames, too."""


def solve_reduced(
    blocks: FloatArray, row: NDArray[np.int32], col: NDArray[np.int32], rhs: FloatArray
) -> FloatArray | None:
    """Solve S x = rhs for S given by its upper blocks (B, 6, 6) at (row, col), row ≤ col, and rhs (C, 6).

    Returns x (C, 6), or None where S is not positive definite.
    """
    count = len(rhs)
    is_dense = count <= DENSE_LIMIT or len(row) > DENSE_SHARE * count * (count + 1) / 2
    try:
        solution = (_solve_dense if is_dense else _solve_sparse)(blocks, row, col, rhs)
    except (np.linalg.LinAlgError, RuntimeError):
        return None
    return solution.reshape(count, 6) if np.all(np.isfinite(solution)) else None


def _solve_dense(blocks: FloatArray, row: NDArray[np.int32], col: NDArray[np.int32], rhs: FloatArray) -> FloatArray:
    count = len(rhs)
    dense = np.zeros((count, 6, count, 6))
    dense[row, :, col, :] = blocks
    factor = scipy.linalg.cho_factor(
        dense.reshape(6 * count, 6 * count), lower=False, overwrite_a=True, check_finite=False
    )
    return np.asarray(scipy.linalg.cho_solve(factor, rhs.ravel(), check_finite=False))


def _solve_sparse(blocks: FloatArray, row: NDArray[np.int32], col: NDArray[np.int32], rhs: FloatArray) -> FloatArray:
    count = len(rhs)
    off = row != col
    rows = np.concatenate([row, col[off]])
    cols = np.concatenate([col, row[off]])
    data = np.concatenate([blocks, blocks[off].transpose(0, 2, 1)])
    within_row, within_col = np.mgrid[0:6, 0:6]
    matrix = scipy.sparse.csc_matrix(
        (
            data.ravel(),
            (
                (rows[:, None, None] * 6 + within_row).ravel(),
                (cols[:, None, None] * 6 + within_col).ravel(),
            ),
        ),
        shape=(6 * count, 6 * count),
    )
    factor = scipy.sparse.linalg.splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return np.asarray(factor.solve(rhs.ravel()))
