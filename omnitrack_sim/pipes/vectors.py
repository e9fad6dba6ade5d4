"""Vectors in compiled functions: three numbers (x, y, z), summed in the order of ``rotations``."""

from __future__ import annotations

import math

from omnitrack_sim.pipes.native import compiled


@compiled
def vector(numbers, start):
    """Return the vector whose three numbers are at ``start``."""
    return numbers[start], numbers[start + 1], numbers[start + 2]


@compiled
def put_vector(numbers, start, a):
    """Write a vector to three numbers at ``start``."""
    numbers[start], numbers[start + 1], numbers[start + 2] = a


@compiled
def plus(a, b):
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def minus(a, b):
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scaled(a, factor):
    """Return a vector times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@compiled
def over(a, divisor):
    """Return a vector divided by a number."""
    return a[0] / divisor, a[1] / divisor, a[2] / divisor


@compiled
def dot(a, b):
    """Return the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a, b):
    """Return the cross product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def in_frame(frame, a):
    """Return a vector in a frame, whose nine numbers are a rotation matrix, row by row."""
    x, y = (frame[0], frame[3], frame[6]), (frame[1], frame[4], frame[7])
    z = (frame[2], frame[5], frame[8])
    return dot(a, x), dot(a, y), dot(a, z)


@compiled
def length(a):
    """Return the length of a vector."""
    return math.sqrt(dot(a, a))


@compiled
def unit(a):
    """Return a vector scaled to length 1; a zero vector stays zero."""
    size = length(a)
    return a if size == 0.0 else over(a, size)


@compiled
def angle_between(a, b):
    """Return the angle, rad, between unit vectors; exact near zero."""
    return 2.0 * math.atan2(length(minus(a, b)), length(plus(a, b)))
