"""How many threads the products of matrices take, decided before NumPy is loaded."""

from __future__ import annotations

import os

__all__ = ["THREAD_VARIABLES", "use_one_thread"]

#: Where a user says how many threads NumPy's BLAS takes.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """One, where the user says nothing: products are small here, and threads that wait for them cost more than they do.

    A sum over several threads also ends in other last bits, and then a release that is built again differs.
    """
    if not any(name in os.environ for name in THREAD_VARIABLES):
        os.environ[THREAD_VARIABLES[0]] = "1"
