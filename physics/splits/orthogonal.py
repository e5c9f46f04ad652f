"""Split of any stiffness C by the principal values of C^(1/2) strain, orthogonal in energy (He and Shao 2019).

With lambda = 0 and mu = 1/2 the spectral law parts that strain so; `cases.splits.ROOTED_SPLITS` has it act there.
"""

from physics.splits.spectral import response

__all__ = ["response"]
