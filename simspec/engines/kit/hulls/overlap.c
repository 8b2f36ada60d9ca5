/* How deep two convex shapes are in each other: the polytope of the differences of their points, grown from within until its
   side nearest to the origin, or its point nearest to an origin that it does not reach, is on the surface of all differences.
   The support function tells of every direction how deep they are at most: what is found is bound from both sides. */
#include "simspec_hulls.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOST_GROWN = 400, MOST_SIDES = 2 * MOST_GROWN };
#define EXACT 2e-14 /* share of the shapes' extent: rounding, by which corners may be off */
#define DOUBT 1e-9  /* m: sides that are left open by more are grown anew */
#define ROUND 1e-12 /* the same where one is round: its sides become so small that nearer ones turn over */

/* The difference of a point of the second and one of the first. */
typedef struct { double x[3], one[3], other[3]; } Difference;
typedef struct { int corner[3], gone, settled; double normal[3], offset; } Side;

typedef struct {
  const Core *one, *other;
  double exact;         /* m: what lengths may be off by */
  int corners, sides;
  Difference corner[MOST_GROWN];
  Side side[MOST_SIDES];
  int from[MOST_SIDES], to[MOST_SIDES];
} Grown;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double *a, const double *b, double *c) {
  for (int i = 0; i < 3; i++) c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static double normalised(double *a) {
  double size = sqrt(dot(a, a));
  for (int i = 0; i < 3 && size > 0; i++) a[i] /= size;
  return size;
}

/* Among points that are equally far the one that a fixed direction tells: a corner of both shapes' faces together, where any of
   a face would make sides of three points on a line. */
static const double tie[3] = {0.48, -0.36, 0.8};

static void farthest(const Core *c, const double *n, double sign, double tied_by, double *x) {
  if (c->round) {
    double along = sign * dot(n, c->axis), rest[3], tied = sign * dot(tie, c->axis);
    for (int i = 0; i < 3; i++) rest[i] = sign * n[i] - along * c->axis[i];
    if (sqrt(dot(rest, rest)) < ROUND)
      for (int i = 0; i < 3; i++) rest[i] = sign * tie[i] - tied * c->axis[i];
    normalised(rest);
    double end = (fabs(along) < ROUND ? tied : along) < 0 ? -c->half : c->half;
    for (int i = 0; i < 3; i++) x[i] = c->centre[i] + end * c->axis[i] + c->rim * rest[i];
    return;
  }
  double best = -HUGE_VAL, second = -HUGE_VAL;
  int chosen = 0;
  for (int k = 0; k < c->count; k++) {
    double height = sign * dot(n, c->point + 3 * k);
    if (height < best - tied_by) continue;
    double tied = sign * dot(tie, c->point + 3 * k);
    if (height > best + tied_by || tied > second) chosen = k, second = tied;
    if (height > best) best = height;
  }
  memcpy(x, c->point + 3 * chosen, 24);
}

/* The difference that is farthest along n: its height. */
static double support(const Grown *g, const double *n, Difference *d) {
  farthest(g->other, n, 1, 0.1 * g->exact, d->other);
  farthest(g->one, n, -1, 0.1 * g->exact, d->one);
  for (int i = 0; i < 3; i++) d->x[i] = d->other[i] - d->one[i];
  return dot(n, d->x);
}

static void add_side(Grown *g, int a, int b, int c) {
  Side *s = g->side + g->sides++;
  double one[3], other[3];
  s->corner[0] = a, s->corner[1] = b, s->corner[2] = c, s->gone = s->settled = 0;
  for (int i = 0; i < 3; i++) one[i] = g->corner[b].x[i] - g->corner[a].x[i], other[i] = g->corner[c].x[i] - g->corner[a].x[i];
  cross(one, other, s->normal);
  normalised(s->normal);
  s->offset = dot(s->normal, g->corner[a].x);
}

/* Four differences that are not in a plane. */
static void begin(Grown *g, const double *towards) {
  double n[3], line[3], best;
  g->corners = 4, g->sides = 0;
  support(g, towards, g->corner);
  for (int i = 0; i < 3; i++) n[i] = -towards[i];
  support(g, n, g->corner + 1);
  for (int i = 0; i < 3; i++) line[i] = g->corner[1].x[i] - g->corner[0].x[i];
  normalised(line);
  double s[3], t[3];
  axes_across(line, s, t);
  best = -1;
  for (int k = 0; k < 4; k++) {
    double away[3], area[3];
    Difference d;
    for (int i = 0; i < 3; i++) n[i] = (k < 2 ? s[i] : t[i]) * (k % 2 ? -1 : 1);
    support(g, n, &d);
    for (int i = 0; i < 3; i++) away[i] = d.x[i] - g->corner[0].x[i];
    cross(line, away, area);
    if (dot(area, area) > best) best = dot(area, area), g->corner[2] = d;
  }
  for (int i = 0; i < 3; i++) t[i] = g->corner[2].x[i] - g->corner[0].x[i];
  cross(line, t, n);
  normalised(n);
  best = -1;
  for (int k = 0; k < 2; k++) {
    Difference d;
    for (int i = 0; i < 3; i++) n[i] = -n[i];
    support(g, n, &d);
    double height = dot(n, d.x) - dot(n, g->corner[0].x);
    if (height > best) best = height, g->corner[3] = d, memcpy(s, n, 24);
  }
  /* s points from the triangle to the fourth: wound outwards, the first three are seen from the other side */
  double a[3], b[3];
  for (int i = 0; i < 3; i++) a[i] = g->corner[1].x[i] - g->corner[0].x[i], b[i] = g->corner[2].x[i] - g->corner[0].x[i];
  cross(a, b, n);
  int one = dot(n, s) > 0 ? 2 : 1, other = 3 - one;
  add_side(g, 0, one, other);
  add_side(g, 0, other, 3);
  add_side(g, other, one, 3);
  add_side(g, one, 0, 3);
}

/* The sides that see a new corner are taken away, and the hole is closed with it. 0 where it is none: of a side of three points
   nearly on a line, as rims have them, the normal is not known. */
static int grow(Grown *g, const Difference *d) {
  int edges = 0, fresh = g->corners, kept = 0;
  if (g->corners == MOST_GROWN) return 0;
  for (int k = 0; k < g->corners; k++) {
    double away = 0;
    for (int i = 0; i < 3; i++) away = fmax(away, fabs(g->corner[k].x[i] - d->x[i]));
    if (away <= g->exact) return 0;
  }
  for (int k = 0; k < g->sides; k++) {
    Side *s = g->side + k;
    s->gone = dot(s->normal, d->x) - s->offset > 0.1 * g->exact;
    for (int i = 0; i < 3 && s->gone; i++) {
      int a = s->corner[i], b = s->corner[(i + 1) % 3], twin = 0;
      while (twin < edges && !(g->from[twin] == b && g->to[twin] == a)) twin++;
      if (twin < edges) edges--, g->from[twin] = g->from[edges], g->to[twin] = g->to[edges];
      else if (edges < MOST_SIDES) g->from[edges] = a, g->to[edges++] = b;
    }
  }
  if (!edges) return 0;
  for (int k = 0; k < g->sides; k++)
    if (!g->side[k].gone) g->side[kept++] = g->side[k];
  if (kept + edges > MOST_SIDES) return 0;
  g->sides = kept, g->corner[g->corners++] = *d;
  for (int k = 0; k < edges; k++) add_side(g, g->from[k], g->to[k], fresh);
  return 1;
}

/* The shares (3,) of a side's corners in its point nearest to the origin: by the regions of its corners and edges (Ericson,
   Real-Time Collision Detection, 5.1.5). */
static void nearest_share(const Grown *g, const Side *s, double *share) {
  const double *a = g->corner[s->corner[0]].x, *b = g->corner[s->corner[1]].x, *c = g->corner[s->corner[2]].x;
  double ab[3], ac[3];
  for (int i = 0; i < 3; i++) ab[i] = b[i] - a[i], ac[i] = c[i] - a[i];
  double d1 = -dot(ab, a), d2 = -dot(ac, a), d3 = -dot(ab, b), d4 = -dot(ac, b), d5 = -dot(ab, c), d6 = -dot(ac, c);
  double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2, t;
  share[0] = share[1] = share[2] = 0;
  if (d1 <= 0 && d2 <= 0) share[0] = 1;
  else if (d3 >= 0 && d4 <= d3) share[1] = 1;
  else if (vc <= 0 && d1 >= 0 && d3 <= 0) t = d1 / (d1 - d3), share[0] = 1 - t, share[1] = t;
  else if (d6 >= 0 && d5 <= d6) share[2] = 1;
  else if (vb <= 0 && d2 >= 0 && d6 <= 0) t = d2 / (d2 - d6), share[0] = 1 - t, share[2] = t;
  else if (va <= 0 && d4 >= d3 && d5 >= d6) t = (d4 - d3) / (d4 - d3 + d5 - d6), share[1] = 1 - t, share[2] = t;
  else share[1] = vb / (va + vb + vc), share[2] = vc / (va + vb + vc), share[0] = 1 - share[1] - share[2];
}

/* What is nearest to the origin: a side from within, of an origin that is outside a point. n: the direction to ask next; returned
   is what depth is at least along it. */
static double nearest(Grown *g, double *n, Side **side, double *share) {
  double least = HUGE_VAL, away = HUGE_VAL, x[3], best[3];
  for (int k = 0; k < g->sides; k++)
    if (!g->side[k].settled && g->side[k].offset < least) least = g->side[k].offset, *side = g->side + k;
  if (least == HUGE_VAL) return least;
  nearest_share(g, *side, share);
  memcpy(n, (*side)->normal, 24);
  if (least >= -g->exact) return least;
  for (int k = 0; k < g->sides; k++) {
    if (g->side[k].settled || g->side[k].offset >= 0) continue;
    nearest_share(g, g->side + k, best);
    memset(x, 0, sizeof x);
    for (int j = 0; j < 3; j++)
      for (int i = 0; i < 3; i++) x[i] += best[j] * g->corner[g->side[k].corner[j]].x[i];
    double far = sqrt(dot(x, x));
    if (far >= away) continue;
    away = far, *side = g->side + k, memcpy(share, best, 24);
    for (int i = 0; i < 3; i++) n[i] = -x[i] / far;
  }
  return -away;
}

static double extent(const Core *c) {
  double most = c->radius;
  for (int i = 0; i < 3 * c->count; i++) most = fmax(most, fabs(c->point[i]));
  return most;
}

static void middle(const Core *c, double *x) {
  memset(x, 0, 24);
  for (int k = 0; k < c->count; k++)
    for (int i = 0; i < 3; i++) x[i] += c->point[3 * k + i] / c->count;
}

/* Grown from one direction on: 0 where they are apart. */
static int grown_from(Grown *g, const double *towards, double around, Overlap *found) {
  double n[3], a[3], b[3], share[3];
  Side *side = 0;
  Difference d;
  begin(g, towards);
  double open = HUGE_VAL, doubt = 0;
  while (open > g->exact) {
    double least = nearest(g, n, &side, share), most;
    if (least == HUGE_VAL) break;
    most = support(g, n, &d);
    if (most + around <= 0) return 0;
    if (most + around < found->depth) {
      found->depth = most + around, memcpy(found->normal, n, 24);
      memset(a, 0, sizeof a), memset(b, 0, sizeof b);
      for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++) {
          a[i] += share[j] * g->corner[side->corner[j]].one[i];
          b[i] += share[j] * g->corner[side->corner[j]].other[i];
        }
      for (int i = 0; i < 3; i++) found->at[i] = (a[i] + b[i] + (g->other->radius - g->one->radius) * n[i]) / 2;
    }
    open = found->depth - around - least;
    if (open > g->exact && !grow(g, &d)) side->settled = 1, doubt = fmax(doubt, open);
  }
  found->doubt = fmin(found->doubt, doubt);
  return 1;
}

int overlap(const Core *one, const Core *other, Overlap *found) {
  double around = one->radius + other->radius, start[3][3], a[3], b[3];
  Difference d;
  middle(one, a), middle(other, b);
  for (int i = 0; i < 3; i++) start[0][i] = a[i] - b[i];
  if (normalised(start[0]) == 0) start[0][2] = 1;
  axes_across(start[0], start[1], start[2]);
  Grown *g = malloc(sizeof *g);
  g->one = one, g->other = other, g->exact = (extent(one) + extent(other)) * (one->round || other->round ? ROUND : EXACT);
  int together = support(g, start[0], &d) + around > 0;
  found->depth = found->doubt = HUGE_VAL;
  /* of 1,000 cylinders four have a side whose normal rounding decides: grown from elsewhere they are looked at once more */
  for (int k = 0; k < 3 && together && found->doubt > DOUBT; k++) together = grown_from(g, start[k], around, found);
  free(g);
  return together;
}
