/* Contact: what may touch, points of contact with the law of their materials, directions of friction. */
#include "simspec_ode.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

static int by_key(const void *a, const void *b) {
  long long x = *(const long long *)a, y = *(const long long *)b;
  return (x > y) - (x < y);
}

int apart(Sim *s, const Shape *one, const Shape *two) {
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
  if (apart(s, a, b)) return;
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
}

static double length(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* A vector without its part along a unit normal, brought to length 1; 0 where nothing is left of it. */
static int across(const double *n, const double *x, double *t) {
  double along = n[0] * x[0] + n[1] * x[1] + n[2] * x[2], size = length(x);
  for (int i = 0; i < 3; i++) t[i] = x[i] - along * n[i];
  double left = length(t);
  if (!(left > 1e-12 * size) || left == 0) return 0;
  for (int i = 0; i < 3; i++) t[i] /= left;
  return 1;
}

/* The first direction of friction. Pyramids: the world's x, of the inscribed one halfway to y; where x is the normal, y. */
static int direction(const Sim *s, const Point *p, double *t) {
  static const double x[3] = {1, 0, 0}, y[3] = {0, 1, 0};
  if (s->cone == ELLIPTIC) return across(p->geom.normal, p->against, t);
  const double *n = p->geom.normal;
  if (fabs(n[0]) > 0.999 ? !across(n, y, t) : !across(n, x, t)) return 0;
  if (s->cone == INSCRIBED) {
    double other[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]};
    for (int i = 0; i < 3; i++) t[i] = (t[i] + other[i]) / sqrt(2);
  }
  return 1;
}

/* Joints of the points for one step. softer: factor of every softness. */
void join(Sim *s, int with_friction, double softer) {
  dJointGroupEmpty(s->joints);
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    const Law *law = p->law;
    dContact c;
    memset(&c, 0, sizeof c);
    c.geom = p->geom;
    c.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM | dContactSlip1 | dContactSlip2;
    c.surface.soft_erp = law->soft_erp;
    c.surface.soft_cfm = c.surface.slip1 = c.surface.slip2 = law->soft_cfm * softer;
    if (law->restitution > 0) {
      c.surface.mode |= dContactBounce;
      c.surface.bounce = law->restitution, c.surface.bounce_vel = law->threshold;
    }
    if (with_friction && law->friction > 0) {
      c.surface.mu = law->friction / (s->cone == INSCRIBED ? sqrt(2) : 1);
      if (with_friction > 1) {
        c.surface.mode &= ~dContactApprox1, c.surface.mu *= p->push;
        if (p->sliding) c.surface.mode |= dContactMu2; /* of 0 */
      }
      if (direction(s, p, c.fdir1)) c.surface.mode |= dContactFDir1;
    }
    dJointID joint = dJointCreateContact(s->world, s->joints, &c);
    dJointAttach(joint, dGeomGetBody(p->geom.g1), dGeomGetBody(p->geom.g2));
    dJointSetFeedback(joint, &p->force);
  }
}

/* How each point slips by the present velocities of ODE's bodies, at the poses that were laid. */
void slips(Sim *s) {
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    memset(p->slip, 0, sizeof p->slip);
    for (int side = 0; side < 2; side++) {
      int carrier = s->body[(side ? p->two : p->one)->body].carrier;
      if (carrier < 0) continue;
      const Body *b = s->body + carrier;
      const dReal *v = dBodyGetLinearVel(b->body), *w = dBodyGetAngularVel(b->body);
      double r[3] = {p->geom.pos[0] - b->c[0], p->geom.pos[1] - b->c[1], p->geom.pos[2] - b->c[2]};
      double moved[3] = {v[0] + w[1] * r[2] - w[2] * r[1], v[1] + w[2] * r[0] - w[0] * r[2], v[2] + w[0] * r[1] - w[1] * r[0]};
      for (int k = 0; k < 3; k++) p->slip[k] += (side ? -1 : 1) * moved[k];
    }
  }
}

/* The force of a point on the first of its shapes in the last step; ODE exchanges the bodies of a joint whose first is the world. */
static void force_on_first(const Point *p, double *f) {
  int first = dGeomGetBody(p->geom.g1) != 0;
  for (int i = 0; i < 3; i++) f[i] = first ? p->force.f1[i] : -p->force.f2[i];
}

/* Friction against the slip without friction: slips() of a step without. */
void aim(Sim *s) {
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    memcpy(p->free, p->slip, 24), memcpy(p->against, p->slip, 24);
  }
}

/* Friction once more, from the slips and normal forces of a step with it. ODE bounds friction by the normal forces without it,
   and by a pyramid: what slips on is given the bound of the forces that came out, against its slip alone, and what sticks, or
   slips less than friction changed in the step, keeps its pyramid with that bound. The largest change, as a share or sine. */
double aim_again(Sim *s) {
  double most = 0;
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    const double *n = p->geom.normal;
    double f[3], push = 0, left[3], old[3], fresh[3], slowed = 0, slipped = 0;
    if (p->law->friction <= 0) continue;
    force_on_first(p, f);
    for (int k = 0; k < 3; k++) push += f[k] * n[k], left[k] = p->free[k] - p->slip[k];
    if (!(push > 0)) push = 0;
    double change = fabs(push - p->push) / (push > 0 ? push : 1);
    p->push = push;
    if (across(n, left, old))
      for (int k = 0; k < 3; k++) slowed += left[k] * old[k];
    if (across(n, p->slip, fresh))
      for (int k = 0; k < 3; k++) slipped += p->slip[k] * fresh[k];
    p->sliding = slipped > slowed;
    if (p->sliding) {
      double turn[3] = {0, 0, 0};
      if (across(n, p->against, old))
        for (int k = 0; k < 3; k++) turn[k] = fresh[k] - old[k];
      if (length(turn) > change) change = length(turn);
      memcpy(p->against, fresh, 24);
    }
    if (change > most) most = change;
  }
  return most;
}

int sim_apart(Sim *s, int one, int two) { return apart(s, s->shape[one], s->shape[two]); }

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
