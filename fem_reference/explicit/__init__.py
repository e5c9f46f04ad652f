"""Finite elements of bodies that move and break."""
