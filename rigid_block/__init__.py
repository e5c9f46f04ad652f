"""A rigid block that rocks on its base: pendulum and Winkler model as solvers of a case, without a mesh."""

from rigid_block.solver import LinearPendulumMotion, PendulumMotion, WinklerMotion, describe

__all__ = ["LinearPendulumMotion", "PendulumMotion", "WinklerMotion", "describe"]
