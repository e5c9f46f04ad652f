"""The indicators of the health record and their limits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Indicator:
    """A number of the health record: what it means, up to where a run is sound, why there, and what to do beyond."""

    meaning: str
    limit: float
    why: str
    remedy: str


INDICATORS = {
    "energy_balance": Indicator(
        "largest energy that is missing or too much, over the largest that there is",
        0.1, "runs that lost an answer were 0.14 to 0.85 off; sound ones are mostly below 0.02",
        'shorten the load increment or the time step, make mesh.h smaller, or set dynamics.order_of_update = "musl"',
    ),
    "missed_peak": Indicator(
        "share by which the largest force may be larger between two increments",
        0.03, "0.06 to 0.3 in bars that were 4 to 26 % too weak, 0.015 at most where the crack announces itself",
        "shorten load.increment and load.smallest, so that increments are short where it breaks",
    ),
    "lagging_crack": Indicator(
        "share by which the largest force is too large because fixed passes leave the crack behind its load",
        0.03, "0.05, 0.12 and 0.24 where it was 0.06, 0.13 and 0.23 too large",
        'shorten load.increment, raise staggered.passes, or set staggered.scheme = "converged"',
    ),
    "lost_at_crossings": Indicator(
        "energy that points at rest lose where they go from cell to cell while nothing breaks, over the largest energy",
        0.03, "0.023 at most in sound runs; 0.035, 0.05 and 0.1 where the force fell by 2, 5 and 10 % at once",
        "set mpm.move_points = false, or make mesh.h smaller where the body is held, loaded or moved the farthest",
    ),
    "phase_field_range": Indicator(
        "how far the phase field leaves 0 to 1",
        0.05, "the fourth order overshoots by up to 0.05 beside a sound crack",
        "make mesh.h smaller than a quarter of the length scale",
    ),
    "face_overlap": Indicator(
        "how far the faces of a slit have gone through each other, over the largest displacement",
        0.01, "faces in contact overlap by 0.003 at most, free ones under pressure by more than 0.03",
        'give the slit contact = true in a quasi-static case, or draw it with kind = "history"',
    ),
    "closed_notch": Indicator(
        "share of the elastic energy that a notch drawn by its history or phase field loses although it is closed",
        0.05, "no_tension loses none of it, spectral a third, others more; an open notch is not asked",
        'draw the notch as a slit in a quasi-static case, or set fracture.split = "no_tension"',
    ),
    "sheared_notch": Indicator(
        "share of the elastic energy that a torn notch drawn by its history or phase field carries in shear while open",
        0.02, "a slit carries none, a notch pulled open 1e-5; sheared, the spectral split a tenth: no crack sets out",
        'draw the notch as a slit, or set fracture.split = "volumetric_deviatoric"',
    ),
    "whole_notch": Indicator(
        "share of the length of a notch drawn by its history field along which the material beside it is whole",
        0.1, "0 where cells are no larger than the length scale; all of it where no integration point lies in the notch",
        "make mesh.h no more than the length scale, or the notch's factor larger",
    ),
    "locking": Indicator(
        "share of the elastic energy in volume changes that alternate, of pressures that do where no volume changes",
        0.05, "0.78 in quadrilaterals that lock, 0.42 in triangles, 0.002 in those that do not",
        "set mesh.locking_free = true in a quasi-static case, or take material points with mpm.order = 2",
    ),
    "resolution": Indicator(
        "share of the squared stress that jumps from cell to cell, where eigenstrains act and F is an energy",
        0.02, "a warm plate clamped on one edge is 8 % off with ten cells along it",
        "make mesh.h smaller",
    ),
    "coarse_cells": Indicator(
        "share of the elastic energy of whole bodies in stress that jumps from cell to cell, about which F is off",
        0.05, "0.17 in a beam of one cell across, 56 % off, 0.03 with four, 4 % off; 0.09 where a point is moved",
        "make mesh.h, or the elements of a mesh file, smaller there, and hold or load a length of edge, not a point",
    ),
    "coarse_tips": Indicator(
        "what the cells at the tips of slits make a whole body too stiff by, as a share of its energy",
        0.03, "solvers whose bases differ part by 2 % there", "make mesh.h smaller at the tips, as by mesh.refine",
    ),
    "coarse_circle": Indicator(
        "largest cell on a circle that hat functions of material points hold, over its radius",
        0.25, "what surrounds a held hole was 2 % too stiff at 0.2, 16 % at 0.4, 14 to 21 % at 0.6",
        "make mesh.h smaller there, as by mesh.refine, or set mpm.order = 2",
    ),
    "coarse_crack": Indicator(
        "share of the new crack's energy in cells larger than the length scale, where cracks take too much force",
        0.05, "0.02 where a crack stays in fine cells, 0.4 to 1 where it bore too much",
        "enlarge mesh.fine, or set mesh.follow_crack = true in a quasi-static case",
    ),
    "held_crack": Indicator(
        "share of the torn crack's energy within a length scale of edges held in x and y, where half a crack's is enough",
        0.25, "0 to 0.2 where it only ends there; along a held edge its profile has one side, so it tears there first",
        "hold the phase field at 1 along it, weld a body of several times the toughness to it, or hold one direction",
    ),
    "unbroken_beside": Indicator(
        "share of the torn crack's energy within a length scale of bodies that cannot break, where half of it is enough",
        0.25, "0 to 0.2 where it only ends there; along such a body it has one side and 0.57 of the energy",
        "give that body's material fracture of several times the toughness, or hold the phase field at 1 along it",
    ),
    "torn_load": Indicator(
        "share of the material within a length scale of tractions that is torn, so that they tear it off and go on alone",
        0.25, "a crack that ends there tears as much of four length scales; torn edges have 0.9 and more",
        "load it less, or less suddenly, or keep what is loaded whole: moving points by bodies.NAME.unbreakable",
    ),
    "quadrature": Indicator(
        "share of the volume in cells with fewer than 2 x 2 material points",
        0.1, "curved edges leave up to 0.03 in sound runs; with one point a cell all of it",
        "set mpm.points_per_cell = 2, or 3 where edges are slanted or curved",
    ),
    "scatter": Indicator(
        "how far the points' middle lies from the cell's middle, over h (root mean square)",
        0.05, "0 for points in order; points at random were 7 to 25 % off",
        'set mpm.placement = "regular" or "gauss"',
    ),
    "bridged_gap": Indicator(
        "length in cells over which material points on both sides of a gap in or between bodies hang together",
        2.5, "2 at the bottom of a V-notch of 30 degrees, 5 to 9 % off; 4 in one of 20, 8 to 15 % off",
        'make mesh.h smaller or the gap wider; at rest a narrow notch may be drawn with kind = "slit" or "cells"',
    ),
    "met_across_gap": Indicator(
        "length in cells of edges that have met others across a gap, where bodies at rest do not press on each other",
        0.0, "elements go through each other at no force, material points hang together, pulled apart as well",
        'load it less far, draw a gap that closes as kind = "slit", or give the table dynamics and solver = "mpm"',
    ),
    "turned": Indicator(
        "angle by which a body has turned whose strains are small ones on its first geometry [radians]",
        0.1, "by 0.1 it has grown by one percent, by 1 to twice its area",
        'run it with solver = "mpm", whose points turn with their stress',
    ),
    "turned_at_rest": Indicator(
        "angle by which whole material at rest has turned whose strains are small ones on its first geometry [radians]",
        0.1, "by 0.1 it has grown by half a percent, and solvers part by 4 % of the force that bends a beam",
        'load it less far, or give the table dynamics and solver = "mpm", whose points turn with their stress',
    ),
    "numerical_fracture": Indicator(
        "pieces that a body which cannot break has fallen into",
        0.0, "what cannot break stays in one piece",
        "make mesh.h smaller, set mpm.points_per_cell = 3 or a larger mpm.order, or load it less far",
    ),
    "left_behind": Indicator(
        "how far material has moved from the grid's nodes that hold its phase field broken, over h",
        0.02, "the force was 0.05 % off at 0.03, 6 % at 0.07: the points beside the crack take another phase field",
        'set mpm.move_points = false, or draw the notch with kind = "history" or "slit"',
    ),
    "crossed_edge": Indicator(
        "share of the material points carrying tractions that have moved into cells of the grid that were empty at first",
        0.0, "few points hold the functions there: F was 10 to 80 % off with splines, 1 % with hats, or had no bound",
        "set mpm.move_points = false, or load it less far",
    ),
    "constraint_error": Indicator(
        "largest distance of a held place from where it should be, over the largest displacement",
        0.01, "1e-4 at most in sound runs",
        "raise mpm.penalty",
    ),
}  # fmt: skip
