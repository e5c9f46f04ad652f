"""Laws that both solvers must agree on: elasticity, energy splits, crack density, exact solutions."""

from physics.kernel_cache import keep_kernels

keep_kernels()
