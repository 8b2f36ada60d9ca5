"""The points about which Newton's solver computes trees, as a function of Warp's. Imported with Newton alone.

Newton's spatial vectors are about the centre of mass of a tree's first link. Where that link cannot move, its mass properties
have no effect, and moments of light links far from the point would lose digits in single precision.
"""

from __future__ import annotations

import warp as wp


@wp.kernel  # type: ignore[untyped-decorator]
def follow(poses: wp.array[wp.transform], centres: wp.array[wp.vec3], pairs: wp.array[wp.vec2i]) -> None:
    """Put the centre of mass of the first link of each pair where that of the second is: ``poses`` of links in the world,
    ``centres`` in the frames of the links (m)."""
    pair = pairs[wp.tid()]
    point = wp.transform_point(poses[pair[1]], centres[pair[1]])
    centres[pair[0]] = wp.transform_point(wp.transform_inverse(poses[pair[0]]), point)
