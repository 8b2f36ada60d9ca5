/* Convex hulls, which ODE is given as a class of geoms of simspec's own: see hulls.c, overlap.c, manifold.c. */
#ifndef SIMSPEC_HULLS_H
#define SIMSPEC_HULLS_H

/* A convex shape: the hull of points in a ball of a radius. A cylinder has, beside points on its rims (for manifold.c), its own
   support function: centre, axis, half its length, rim. All relative to a place near both shapes of a pair. */
typedef struct {
  int count; double *point, radius;
  int round; double centre[3], axis[3], half, rim;
} Core;

/* How deep (m) the first shape is in the second: moved by that along the normal it would only touch. Where they are deepest, the
   halfway point. doubt: what depth may be too large by. */
typedef struct { double normal[3], at[3], depth, doubt; } Overlap;

enum { MOST_CORNERS = 16 }; /* points of contact of one pair */

/* overlap.c: whether they overlap, and how. */
int overlap(const Core *one, const Core *other, Overlap *found);

/* manifold.c: up to MOST_CORNERS points x y z depth of an overlap, the deepest first; other 0: all below the plane through found->at. */
int manifold(const Core *one, const Core *other, const Overlap *found, double *points);
void rims(Core *cylinder, const double *towards);
void axes_across(const double *normal, double *s, double *t);
#endif
