"""Laws that both solvers must agree on: elasticity, energy splits, crack density, exact solutions."""
