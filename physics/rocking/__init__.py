"""Rigid blocks that rock on a moving ground, without a mesh: the inverted pendulum and the Winkler model."""
