"""Meshes of a case's bodies: built, or read from a file."""
