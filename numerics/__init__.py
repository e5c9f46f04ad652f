"""What is true of any discretisation: staggered scheme, load increments, sparse patterns, linear solvers."""
