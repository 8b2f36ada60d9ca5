/* Convex hulls as a class of geoms, by which ODE's own collision asks for their boxes and for their points of contact with
   everything else. ODE's own convex geoms meet boxes, cylinders and each other in one point, or in a plane of points. */
#include "simspec_hulls.h"
#include <ode/ode.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static int hull_class = -1;
static long doubtful;
#define DOUBT 1e-8 /* m: what a depth may be uncertain by without a word */

/* What a geom of the class has: the vertices in its frame. */
typedef struct { int count; double *vertex; } Hull;

static void in_world(dGeomID g, const double *x, const double *from, double *found) {
  const dReal *p = dGeomGetPosition(g), *R = dGeomGetRotation(g);
  for (int i = 0; i < 3; i++) found[i] = R[4 * i] * x[0] + R[4 * i + 1] * x[1] + R[4 * i + 2] * x[2] + (p[i] - from[i]);
}

static void box_around(dGeomID g, dReal box[6]) {
  static const double origin[3] = {0, 0, 0};
  const Hull *h = dGeomGetClassData(g);
  for (int i = 0; i < 3; i++) box[2 * i] = HUGE_VAL, box[2 * i + 1] = -HUGE_VAL;
  for (int k = 0; k < h->count; k++) {
    double x[3];
    in_world(g, h->vertex + 3 * k, origin, x);
    for (int i = 0; i < 3; i++) box[2 * i] = fmin(box[2 * i], x[i]), box[2 * i + 1] = fmax(box[2 * i + 1], x[i]);
  }
}

static void forget(dGeomID g) { free(((Hull *)dGeomGetClassData(g))->vertex); }

/* A geom as points and a radius about a place. 0 where it is no such. */
static int core(dGeomID g, const double *from, Core *c) {
  memset(c, 0, sizeof *c);
  const double origin[3] = {0, 0, 0};
  int kind = dGeomGetClass(g);
  if (kind == hull_class) {
    const Hull *h = dGeomGetClassData(g);
    c->point = malloc((c->count = h->count) * 24);
    for (int k = 0; k < h->count; k++) in_world(g, h->vertex + 3 * k, from, c->point + 3 * k);
  } else if (kind == dSphereClass) {
    c->point = malloc(24), c->count = 1, c->radius = dGeomSphereGetRadius(g);
    in_world(g, origin, from, c->point);
  } else if (kind == dBoxClass) {
    dVector3 sides;
    dGeomBoxGetLengths(g, sides);
    c->point = malloc((c->count = 8) * 24);
    for (int k = 0; k < 8; k++) {
      double x[3];
      for (int i = 0; i < 3; i++) x[i] = (k >> i & 1 ? 0.5 : -0.5) * sides[i];
      in_world(g, x, from, c->point + 3 * k);
    }
  } else if (kind == dCapsuleClass) {
    dReal length;
    dGeomCapsuleGetParams(g, &c->radius, &length);
    c->point = malloc((c->count = 2) * 24);
    for (int k = 0; k < 2; k++) {
      double x[3] = {0, 0, (k - 0.5) * length};
      in_world(g, x, from, c->point + 3 * k);
    }
  } else if (kind == dCylinderClass) {
    dReal length, up[3] = {0, 0, 1};
    dGeomCylinderGetParams(g, &c->rim, &length);
    c->round = 1, c->half = length / 2, c->point = malloc(64 * 24);
    in_world(g, origin, from, c->centre);
    in_world(g, up, from, c->axis);
    for (int i = 0; i < 3; i++) c->axis[i] -= c->centre[i];
    rims(c, c->axis);
  }
  return c->count;
}

static int collide(dGeomID one, dGeomID other, int flags, dContactGeom *contact, int skip) {
  double points[4 * MOST_CORNERS], from[3];
  int count = 0, most = flags & 0xffff;
  Core a = {0}, b = {0};
  Overlap found = {{0, 0, 0}, {0, 0, 0}, 0, 0};
  for (int i = 0; i < 3; i++) from[i] = dGeomGetPosition(one)[i];
  core(one, from, &a);
  if (dGeomGetClass(other) == dPlaneClass) {
    dVector4 plane;
    dGeomPlaneGetParams(other, plane);
    double level = plane[3] - dDOT(plane, from);
    memcpy(found.normal, plane, 24), found.depth = -HUGE_VAL;
    for (int k = 0; k < a.count; k++) {
      double depth = level - dDOT(plane, a.point + 3 * k);
      if (depth <= found.depth) continue;
      found.depth = depth;
      for (int i = 0; i < 3; i++) found.at[i] = a.point[3 * k + i] + depth * plane[i];
    }
    if (found.depth > 0) count = manifold(&a, 0, &found, points);
  } else if (core(other, from, &b) && overlap(&a, &b, &found)) {
    double down[3] = {-found.normal[0], -found.normal[1], -found.normal[2]};
    if (a.round) rims(&a, down);
    if (b.round) rims(&b, found.normal);
    doubtful += found.doubt > DOUBT;
    count = manifold(&a, &b, &found, points);
  }
  if (count > most) count = most;
  for (int k = 0; k < count; k++) {
    dContactGeom *c = (dContactGeom *)((char *)contact + k * skip);
    for (int i = 0; i < 3; i++) c->pos[i] = points[4 * k + i] + from[i];
    memcpy(c->normal, found.normal, 24);
    c->depth = points[4 * k + 3], c->g1 = one, c->g2 = other, c->side1 = c->side2 = -1;
  }
  free(a.point), free(b.point);
  return count;
}

static dColliderFn *collider(int kind) {
  int has = kind == hull_class || kind == dSphereClass || kind == dBoxClass || kind == dCapsuleClass ||
            kind == dCylinderClass || kind == dPlaneClass;
  return has ? collide : 0;
}

/* Tells ODE of the class, once in a process. */
void hulls_start(void) {
  dGeomClass told = {sizeof(Hull), collider, box_around, 0, forget};
  if (hull_class < 0) hull_class = dCreateGeomClass(&told);
}

dGeomID hull_new(dSpaceID space, const double *vertices, int count) {
  Hull *h;
  dGeomID g = dCreateGeom(hull_class);
  h = dGeomGetClassData(g);
  h->count = count, h->vertex = malloc(count * 24);
  memcpy(h->vertex, vertices, count * 24);
  dSpaceAdd(space, g);
  return g;
}

/* Puts a hull where the geom of a space with this data is, which is then out of use; 0 where there is none. */
dGeomID hull_instead(dSpaceID space, void *data, const double *vertices, int count) {
  dGeomID before = 0, g;
  for (int k = 0; k < dSpaceGetNumGeoms(space); k++)
    if (dGeomGetData(dSpaceGetGeom(space, k)) == data) before = dSpaceGetGeom(space, k);
  if (!before || !dGeomGetBody(before)) return 0;
  hulls_start();
  g = hull_new(space, vertices, count);
  dGeomSetData(g, data);
  dGeomSetBody(g, dGeomGetBody(before));
  dGeomDisable(before);
  return g;
}

/* Takes it away; what it stands for stays out of use. */
void hull_gone(dGeomID g) { dGeomDestroy(g); }

/* Whether a geom is a hull in use. */
int hull_is(dGeomID g) { return dGeomGetClass(g) == hull_class && dGeomIsEnabled(g); }

/* How many overlaps were found with doubt since it was asked last. */
long hulls_doubted(void) {
  long count = doubtful;
  doubtful = 0;
  return count;
}

/* The vertices that a hull's geom has: their number, and where there is room for them which. */
int hull_vertices(dGeomID g, double *vertices) {
  const Hull *h = dGeomGetClassData(g);
  if (vertices) memcpy(vertices, h->vertex, h->count * 24);
  return h->count;
}
