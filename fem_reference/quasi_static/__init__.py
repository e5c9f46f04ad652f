"""Finite elements under loads that change slowly (thesis Algorithm 1)."""
