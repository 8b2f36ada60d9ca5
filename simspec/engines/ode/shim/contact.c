/* Contact: what may touch, points of contact with the law of their materials, directions of friction. */
#include "simspec_ode.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

static int by_key(const void *a, const void *b) {
  long long x = *(const long long *)a, y = *(const long long *)b;
  return (x > y) - (x < y);
}

int excluded(Sim *s, const Shape *one, const Shape *two) {
  const Body *a = s->body + one->body, *b = s->body + two->body;
  if (a->rigid == b->rigid) return 1; /* of one rigid group, or both still */
  if (!s->law[one->material * s->materials + two->material].collide) return 1;
  if (s->ignored[one->group * s->groups + two->group]) return 1;
  if (!s->excluded_count) return 0;
  long long low = one->body < two->body ? one->body : two->body, high = one->body + two->body - low;
  long long key = low * s->bodies + high;
  return bsearch(&key, s->excluded, s->excluded_count, sizeof key, by_key) != 0;
}

static void near(void *data, dGeomID one, dGeomID two) {
  Sim *s = data;
  Shape *a = dGeomGetData(one), *b = dGeomGetData(two);
  if (excluded(s, a, b)) return;
  if (s->points + MOST_POINTS > s->room) {
    s->room = 2 * s->room + MOST_POINTS;
    s->point = realloc(s->point, s->room * sizeof(Point));
  }
  dContactGeom found[MOST_POINTS];
  int count = dCollide(one, two, MOST_POINTS, found, sizeof(dContactGeom));
  for (int i = 0; i < count; i++) {
    Point *p = s->point + s->points++;
    memset(p, 0, sizeof *p);
    p->geom = found[i];
    p->one = dGeomGetData(found[i].g1), p->two = dGeomGetData(found[i].g2);
    p->law = s->law + a->material * s->materials + b->material;
  }
}

/* The points of contact of the present poses. */
void detect(Sim *s) {
  s->points = 0;
  if (s->contact && s->shapes > 1) dSpaceCollide(s->space, s, near);
  s->doubtful += hulls_doubted();
}

double length(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* A vector without its part along a unit normal, brought to length 1; 0 where nothing is left of it. */
int across(const double *n, const double *x, double *t) {
  double along = n[0] * x[0] + n[1] * x[1] + n[2] * x[2], size = length(x);
  for (int i = 0; i < 3; i++) t[i] = x[i] - along * n[i];
  double left = length(t);
  if (!(left > 1e-12 * size) || left == 0) return 0;
  for (int i = 0; i < 3; i++) t[i] /= left;
  return 1;
}

/* The first direction of friction. Pyramids: the world's x, of the inscribed one halfway to y; where x is the normal, y. */
int direction(const Sim *s, const Point *p, double *t) {
  static const double x[3] = {1, 0, 0}, y[3] = {0, 1, 0};
  if (s->cone == ELLIPTIC) {
    dVector3 one, other;
    if (across(p->geom.normal, p->against, t)) return 1;
    dPlaneSpace(p->geom.normal, one, other); /* as ODE does where it is given none */
    memcpy(t, one, 24);
    return 1;
  }
  const double *n = p->geom.normal;
  if (fabs(n[0]) > 0.999 ? !across(n, y, t) : !across(n, x, t)) return 0;
  if (s->cone == INSCRIBED) {
    double other[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]};
    for (int i = 0; i < 3; i++) t[i] = (t[i] + other[i]) / sqrt(2);
  }
  return 1;
}

/* Whether the friction of a law is solved for more than once (passes.c): what ODE's own contacts do not bound as the law says.
   dWorldQuickStep bounds a pyramid by the present normal forces in every iteration. */
int rubs(const Sim *s, const Law *law) {
  return (law->friction > 0 && !(s->quick && s->cone != ELLIPTIC)) || law->torsional > 0 || law->rolling > 0;
}

/* Two directions across a normal, the first along x where that is across it at all. */
void frame(const double *n, const double *x, double *one, double *other) {
  static const double axes[2][3] = {{1, 0, 0}, {0, 1, 0}};
  if (!across(n, x, one)) across(n, axes[fabs(n[0]) > 0.7], one);
  for (int i = 0; i < 3; i++) other[i] = n[(i + 1) % 3] * one[(i + 2) % 3] - n[(i + 2) % 3] * one[(i + 1) % 3];
}

static void motor(Sim *s, const Point *p, const double *most, double cfm) {
  static const int limits[3] = {dParamFMax, dParamFMax2, dParamFMax3}, speeds[3] = {dParamVel, dParamVel2, dParamVel3};
  static const int softnesses[3] = {dParamCFM, dParamCFM2, dParamCFM3};
  double axis[3][3];
  int rows = 0;
  for (int i = 0; i < 3; i++) rows += most[i] > 0;
  if (!rows) return;
  memcpy(axis[0], p->geom.normal, 24);
  frame(p->geom.normal, p->rolling, axis[1], axis[2]);
  dJointID made = dJointCreateAMotor(s->world, s->joints);
  dJointAttach(made, dGeomGetBody(p->geom.g1), dGeomGetBody(p->geom.g2));
  dJointSetAMotorMode(made, dAMotorUser);
  dJointSetAMotorNumAxes(made, rows);
  for (int i = 0, row = 0; i < 3; i++) {
    if (!(most[i] > 0)) continue;
    dJointSetAMotorAxis(made, row, 0, axis[i][0], axis[i][1], axis[i][2]);
    dJointSetAMotorParam(made, limits[row], most[i]);
    dJointSetAMotorParam(made, speeds[row], 0);
    dJointSetAMotorParam(made, softnesses[row], cfm);
    row++;
  }
}

/* Torsional and rolling friction: motors of speed 0 along and across the normal, one for all points at which two bodies touch with
   the same normal, since their torques are the same rows; ODE's own, one for each point, have no solution where several are at
   their limits. Torques are bound by the normal forces of the pass before; rolling as sliding goes against the turning. */
static void hinder(Sim *s, double softer) {
  for (int i = 0; i < s->points; i++) s->point[i].told = 0;
  for (int i = 0; i < s->points; i++) {
    const Point *p = s->point + i;
    dBodyID one = dGeomGetBody(p->geom.g1), other = dGeomGetBody(p->geom.g2);
    double most[3] = {0, 0, 0};
    if (p->told || !(p->law->torsional > 0 || p->law->rolling > 0)) continue;
    for (int k = i; k < s->points; k++) {
      Point *next = s->point + k;
      dBodyID a = dGeomGetBody(next->geom.g1), b = dGeomGetBody(next->geom.g2);
      if (next->told || !((a == one && b == other) || (a == other && b == one))) continue;
      const double *n = p->geom.normal, *m = next->geom.normal;
      if (fabs(n[0] * m[0] + n[1] * m[1] + n[2] * m[2]) < SAME_NORMAL) continue;
      next->told = 1;
      most[0] += next->law->torsional * next->bound;
      most[1] += next->law->rolling * next->bound;
    }
    most[2] = p->rolls ? 0 : most[1];
    motor(s, p, most, p->law->soft_cfm * softer);
  }
}

/* Joints of the points for one step. with_friction: 0 without, 1 in the first pass with it, 2 in those that follow. softer: factor of
   every softness. nudge: speeds (m/s) by which points are to part faster, each its own: where two rows come to a bound at once, ODE's
   solver ends without a solution. */
void join(Sim *s, int with_friction, double softer, double nudge) {
  dJointGroupEmpty(s->joints);
  if (with_friction) hinder(s, softer);
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    const Law *law = p->law;
    dContact c;
    memset(&c, 0, sizeof c);
    c.geom = p->geom;
    c.geom.depth += nudge * (1 + i % NUDGES) * s->timestep / law->soft_erp;
    c.surface.mode = dContactSoftERP | dContactSoftCFM | dContactSlip1 | dContactSlip2;
    c.surface.soft_erp = law->soft_erp;
    c.surface.soft_cfm = c.surface.slip1 = c.surface.slip2 = law->soft_cfm * softer;
    if (law->restitution > 0) {
      c.surface.mode |= dContactBounce;
      c.surface.bounce = law->restitution, c.surface.bounce_vel = law->threshold;
    }
    if (with_friction && law->friction > 0) {
      c.surface.mu = law->friction / (s->cone == INSCRIBED ? sqrt(2) : 1);
      /* the first pass's bounds, by the normal forces without friction, ODE computes itself: its solver is faster so */
      if (!rubs(s, law) || (with_friction == 1 && p->bound == p->push)) c.surface.mode |= dContactApprox1;
      else c.surface.mu = p->held ? dInfinity : c.surface.mu * p->bound;
      if (p->sliding) c.surface.mode |= dContactMu2; /* of 0 */
      else if (nudge > 0 && !p->held) c.surface.mode |= dContactMu2, c.surface.mu2 = c.surface.mu * (1 - UNTIED * (1 + i % NUDGES));
      if (direction(s, p, c.fdir1)) c.surface.mode |= dContactFDir1;
    }
    dJointID joint = dJointCreateContact(s->world, s->joints, &c);
    dJointAttach(joint, dGeomGetBody(p->geom.g1), dGeomGetBody(p->geom.g2));
    dJointSetFeedback(joint, &p->force);
  }
}

/* How each point slips and turns by the present velocities of ODE's bodies, at the poses that were laid. */
void slips(Sim *s) {
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    memset(p->slip, 0, sizeof p->slip), memset(p->turn, 0, sizeof p->turn);
    for (int side = 0; side < 2; side++) {
      int carrier = s->body[(side ? p->two : p->one)->body].carrier;
      if (carrier < 0) continue;
      const Body *b = s->body + carrier;
      const dReal *v = dBodyGetLinearVel(b->body), *w = dBodyGetAngularVel(b->body);
      double r[3] = {p->geom.pos[0] - b->c[0], p->geom.pos[1] - b->c[1], p->geom.pos[2] - b->c[2]};
      double moved[3] = {v[0] + w[1] * r[2] - w[2] * r[1], v[1] + w[2] * r[0] - w[0] * r[2], v[2] + w[0] * r[1] - w[1] * r[0]};
      for (int k = 0; k < 3; k++) p->slip[k] += (side ? -1 : 1) * moved[k], p->turn[k] += (side ? -1 : 1) * w[k];
    }
  }
}

int sim_excluded(Sim *s, int one, int two) { return excluded(s, s->shape[one], s->shape[two]); }

/* Pairs of shapes that touch at the present state: their number; of those that fit into pairs (room, 2) which. */
int sim_touching(Sim *s, int *pairs, int room) {
  int told = s->points, contact = s->contact;
  Point *kept = malloc((told + 1) * sizeof(Point));
  if (told) memcpy(kept, s->point, told * sizeof(Point));
  s->contact = 1;
  detect(s);
  int count = s->points;
  for (int i = 0; i < count && i < room; i++) pairs[2 * i] = s->point[i].one->unit, pairs[2 * i + 1] = s->point[i].two->unit;
  if (told) memcpy(s->point, kept, told * sizeof(Point));
  s->points = told, s->contact = contact;
  free(kept);
  return count;
}

/* The points of the last step: the shapes (n, 2), position, normal from the second to the first, depth, force along the normal
   (n, 8). */
void sim_points(const Sim *s, int *units, double *numbers) {
  for (int i = 0; i < s->points; i++) {
    const Point *p = s->point + i;
    const double *n = p->geom.normal;
    double f[3];
    force_on_first(p, f);
    units[2 * i] = p->one->unit, units[2 * i + 1] = p->two->unit;
    double *x = numbers + 8 * i;
    memcpy(x, p->geom.pos, 24), memcpy(x + 3, n, 24);
    x[6] = p->geom.depth;
    x[7] = f[0] * n[0] + f[1] * n[1] + f[2] * n[2];
  }
}

void sim_contact(Sim *s, int on) { s->contact = on; }
