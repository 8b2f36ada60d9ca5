/* Where two shapes that overlap touch: what each has in the other beyond the other's outermost plane, projected along the normal,
   cut with each other, each place with its own depth. A face on a face has the corners of what they share, an edge on a face two
   points, edges that cross one. */
#include "simspec_hulls.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FLAT 1e-9 /* share of an outline's extent below which it is a line, or a point */

enum { RIM = 16 };
#define PI 3.14159265358979323846

/* A place in the plane across the normal, with a height along it. */
typedef struct { double x, y, z; } Place;
typedef struct { int count; Place *place; double slope[2], level; } Outline;

void axes_across(const double *n, double *s, double *t) {
  int k = fabs(n[0]) < fabs(n[1]) ? (fabs(n[0]) < fabs(n[2]) ? 0 : 2) : (fabs(n[1]) < fabs(n[2]) ? 1 : 2);
  double size = 0;
  for (int i = 0; i < 3; i++) s[i] = (i == k) - n[i] * n[k], size += s[i] * s[i];
  for (int i = 0; i < 3; i++) s[i] /= sqrt(size);
  for (int i = 0; i < 3; i++) t[i] = n[(i + 1) % 3] * s[(i + 2) % 3] - n[(i + 2) % 3] * s[(i + 1) % 3];
}

/* Points on a cylinder's rims, of which one is the farthest in a direction. */
void rims(Core *c, const double *towards) {
  double along = 0, s[3], t[3], size = 0;
  axes_across(c->axis, s, t);
  for (int i = 0; i < 3; i++) along += towards[i] * c->axis[i];
  double first[3];
  for (int i = 0; i < 3; i++) first[i] = towards[i] - along * c->axis[i], size += first[i] * first[i];
  if (size > 1e-18) {
    for (int i = 0; i < 3; i++) s[i] = first[i] / sqrt(size);
    for (int i = 0; i < 3; i++) t[i] = c->axis[(i + 1) % 3] * s[(i + 2) % 3] - c->axis[(i + 2) % 3] * s[(i + 1) % 3];
  }
  c->count = 2 * RIM;
  for (int k = 0; k < 2 * RIM; k++) {
    double turn = 2 * PI * (k % RIM) / RIM, end = k < RIM ? -c->half : c->half;
    for (int i = 0; i < 3; i++)
      c->point[3 * k + i] = c->centre[i] + end * c->axis[i] + c->rim * (cos(turn) * s[i] + sin(turn) * t[i]);
  }
}

static double area(const Place *a, const Place *b, const Place *c) {
  return (b->x - a->x) * (c->y - a->y) - (b->y - a->y) * (c->x - a->x);
}

static double squared(const Place *a, const Place *b) { return (b->x - a->x) * (b->x - a->x) + (b->y - a->y) * (b->y - a->y); }

static int leftmost(const void *one, const void *other) {
  const Place *a = one, *b = other;
  if (a->x != b->x) return a->x < b->x ? -1 : 1;
  if (a->y != b->y) return a->y < b->y ? -1 : 1;
  return (a->z > b->z) - (a->z < b->z);
}

/* The corners of what is less deep than slab behind the outermost plane; sign -1: of what is lowest. */
static Outline outline(const Core *c, const double *n, const double *s, const double *t, double sign, double depth) {
  Outline o = {0, malloc((c->count + 1) * sizeof(Place)), {0, 0}, 0};
  Place *all = malloc((c->count + 1) * sizeof(Place));
  double most = -HUGE_VAL, least = HUGE_VAL, extent = 0;
  int count = 0;
  for (int k = 0; k < c->count; k++) {
    const double *x = c->point + 3 * k;
    double z = n[0] * x[0] + n[1] * x[1] + n[2] * x[2];
    all[k] = (Place){s[0] * x[0] + s[1] * x[1] + s[2] * x[2], t[0] * x[0] + t[1] * x[1] + t[2] * x[2], z + sign * c->radius};
    most = fmax(most, sign * all[k].z), least = fmin(least, sign * all[k].z);
    extent = fmax(extent, squared(all, all + k));
  }
  double slab = c->count > 2 ? fmin(depth, (most - least) / 2) : depth; /* not of a thin shape's other side */
  for (int k = 0; k < c->count; k++)
    if (sign * all[k].z >= most - slab - 1e-15) all[count++] = all[k];
  qsort(all, count, sizeof(Place), leftmost);
  /* monotone chain: below, then above */
  for (int half = 0; half < 2; half++) {
    int base = o.count;
    for (int k = 0; k < count; k++) {
      Place *p = all + (half ? count - 1 - k : k);
      while (o.count > base + 1 && area(o.place + o.count - 2, o.place + o.count - 1, p) <= FLAT * FLAT * extent) o.count--;
      if (o.count > base && squared(o.place + o.count - 1, p) <= FLAT * FLAT * extent) continue;
      if (o.count > c->count) break;
      o.place[o.count++] = *p;
    }
    if (o.count > base + 1 || half) o.count--; /* the other half begins with it */
    if (!half && count == 1) break;
  }
  if (!o.count && count) o.place[o.count++] = all[0];
  double twice = 0, normal[3] = {0, 0, 0};
  for (int k = 0; k < o.count; k++) {
    const Place *a = o.place + k, *b = o.place + (k + 1) % o.count;
    normal[0] += (a->y - b->y) * (a->z + b->z), normal[1] += (a->z - b->z) * (a->x + b->x);
    normal[2] += (a->x - b->x) * (a->y + b->y);
    twice += area(o.place, a, b);
  }
  if (o.count > 2 && twice <= FLAT * extent) { /* a line: its two ends */
    int far = 0;
    for (int k = 1; k < o.count; k++)
      if (squared(o.place, o.place + k) > squared(o.place, o.place + far)) far = k;
    o.place[1] = o.place[far], o.count = 2;
  }
  if (o.count > 2) { /* Newell's plane through its corners */
    o.slope[0] = -normal[0] / normal[2], o.slope[1] = -normal[1] / normal[2];
    for (int k = 0; k < o.count; k++)
      o.level += (o.place[k].z - o.slope[0] * o.place[k].x - o.slope[1] * o.place[k].y) / o.count;
  }
  free(all);
  return o;
}

/* A point, line or outline cut with the inside of an outline: the number of places left, in cut, which has room. */
static int cut_with(const Outline *what, const Outline *by, Place *cut, Place *spare) {
  int count = what->count;
  memcpy(cut, what->place, count * sizeof(Place));
  for (int k = 0; k < by->count && count; k++) {
    const Place *a = by->place + k, *b = by->place + (k + 1) % by->count;
    double tolerated = -FLAT * squared(a, b);
    int left = 0;
    for (int i = 0; i < count; i++) {
      const Place *p = cut + i, *q = cut + (i + 1) % count;
      double here = area(a, b, p), next = area(a, b, q);
      if (here >= tolerated) spare[left++] = *p;
      if ((here >= tolerated) != (next >= tolerated) && (count > 2 || i + 1 < count)) {
        double share = here / (here - next);
        spare[left++] = (Place){p->x + share * (q->x - p->x), p->y + share * (q->y - p->y), p->z + share * (q->z - p->z)};
      }
    }
    count = left;
    memcpy(cut, spare, count * sizeof(Place));
  }
  return count;
}

/* The deepest place, then always the one that is farthest from those that are chosen. */
static int spread(Place *found, int count, Place *chosen) {
  int taken = 0, next = 0;
  double *far = malloc((count + 1) * sizeof(double));
  for (int k = 0; k < count; k++) {
    far[k] = HUGE_VAL;
    if (found[k].z > found[next].z) next = k;
  }
  while (taken < MOST_CORNERS && taken < count) {
    chosen[taken++] = found[next];
    int best = -1;
    for (int k = 0; k < count; k++) {
      far[k] = k == next ? -1 : fmin(far[k], squared(found + next, found + k));
      if (far[k] >= 0 && (best < 0 || far[k] > far[best])) best = k;
    }
    next = best;
  }
  free(far);
  return taken;
}

int manifold(const Core *one, const Core *other, const Overlap *found, double *points) {
  double s[3], t[3];
  axes_across(found->normal, s, t);
  Outline low = outline(one, found->normal, s, t, -1, found->depth), high = {0, 0, {0, 0}, 0};
  double level = 0;
  if (other) high = outline(other, found->normal, s, t, 1, found->depth);
  else
    for (int i = 0; i < 3; i++) level += found->normal[i] * found->at[i];
  int room = 2 * (low.count + high.count) + 2, count = 0, kept = 0, turned_round = low.count < 3;
  Place *cut = malloc(room * sizeof(Place)), *spare = malloc(room * sizeof(Place)), chosen[MOST_CORNERS];
  const Outline *what = turned_round ? &low : &high, *by = turned_round ? &high : &low;
  if (!other) memcpy(cut, low.place, (count = low.count) * sizeof(Place));
  else if (by->count > 2) count = cut_with(what, by, cut, spare);
  for (int k = 0; k < count; k++) { /* a place's height becomes its depth, its place halfway */
    double facing = other ? by->level + by->slope[0] * cut[k].x + by->slope[1] * cut[k].y : level;
    double depth = !other || turned_round ? facing - cut[k].z : cut[k].z - facing;
    if (depth > 0) cut[kept++] = (Place){cut[k].x, cut[k].y, fmin(depth, found->depth)};
  }
  count = spread(cut, kept, chosen);
  double middle = other ? 0 : level;
  for (int i = 0; other && i < 3; i++) middle += found->normal[i] * found->at[i];
  if (!count || chosen[0].z < (1 - 1e-3) * found->depth) { /* edges that cross, and what is round */
    if (count == MOST_CORNERS) count--;
    memmove(chosen + 1, chosen, count++ * sizeof(Place));
    chosen[0] = (Place){0, 0, found->depth};
    for (int i = 0; i < 3; i++) chosen[0].x += s[i] * found->at[i], chosen[0].y += t[i] * found->at[i];
  }
  for (int k = 0; k < count; k++) {
    for (int i = 0; i < 3; i++) points[4 * k + i] = chosen[k].x * s[i] + chosen[k].y * t[i] + middle * found->normal[i];
    points[4 * k + 3] = chosen[k].z;
  }
  free(cut), free(spare), free(low.place), free(high.place);
  return count;
}
