"""Scalars of finished runs: curves, crack paths, cracks that run, bodies that move; no files."""
