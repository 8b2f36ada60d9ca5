/* Friction whose bounds follow from the normal forces that it changes: a step is solved in passes, each with bounds from the normal
   forces of the one before, until they fit. ODE's own solver bounds friction once, by the normal forces that would be without it: a
   ladder that leans on a smooth wall, a clamp that holds itself by its own weight and three balls on each other need it anew. */
#include "simspec_ode.h"
#include <math.h>
#include <string.h>

#define SEED 0.01 /* of the lighter body's weight: the first bound where the normal force without friction is less, to grow from */
#define LEAST 1e-5 /* of that weight: what friction may miss its law by */
#define STEEP 0.9 /* of a change of bounds comes back as a change of normal forces: above it, passes get nowhere by themselves */
#define LEAST_TURN 0.05 /* least share of a turn by which friction is turned */
#define TURNED 0.03 /* sine of a turn of friction beyond which normal forces do not go on as in the last pass */
#define FARTHEST 50 /* times the last change of normal forces, by which bounds are carried on at most */
#define SLOW 1e-6 /* of the speed that gravity gives in a step: what slips less sticks */
#define FAST 20 /* of that speed: what slips faster is not held within a step, and no pass without a bound is tried for it */
#define FULL (1 - 1e-6) /* of its bound, from which on a friction force counts as bound */

/* The force of a point on the first of its shapes in the last step; ODE exchanges the bodies of a joint whose first is the world. */
void force_on_first(const Point *p, double *f) {
  int first = dGeomGetBody(p->geom.g1) != 0;
  for (int i = 0; i < 3; i++) f[i] = first ? p->force.f1[i] : -p->force.f2[i];
}

static double normal_force(const Point *p) {
  double f[3];
  force_on_first(p, f);
  double push = f[0] * p->geom.normal[0] + f[1] * p->geom.normal[1] + f[2] * p->geom.normal[2];
  return push > 0 ? push : 0;
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* The weight (N) of the lighter of the two bodies of a point that move. */
static double weight(Sim *s, const Point *p) {
  dVector3 g;
  double least = dInfinity;
  dWorldGetGravity(s->world, g);
  for (int side = 0; side < 2; side++) {
    int carrier = s->body[(side ? p->two : p->one)->body].carrier;
    dMass m;
    if (carrier < 0) continue;
    dBodyGetMass(s->body[carrier].body, &m);
    if (m.mass < least) least = m.mass;
  }
  return least * sqrt(dot(g, g));
}

static int first_of(Sim *s, int k) {
  while (s->body[k].group.first != k) k = s->body[k].group.first = s->body[s->body[k].group.first].group.first;
  return k;
}

static void unite(Sim *s, int one, int other) {
  if (one < 0 || other < 0) return;
  one = first_of(s, one), other = first_of(s, other);
  s->body[one > other ? one : other].group.first = one < other ? one : other;
}

/* Groups of the bodies that carry others: by joints and by points of contact. */
static void groups(Sim *s) {
  for (int k = 0; k < s->bodies; k++) memset(&s->body[k].group, 0, sizeof(Group)), s->body[k].group.first = k;
  for (int k = 0; k < s->bodies; k++)
    if (s->body[k].parent >= 0) unite(s, s->body[k].carrier, s->body[s->body[k].parent].carrier);
  for (int i = 0; i < s->points; i++) unite(s, s->body[s->point[i].one->body].carrier, s->body[s->point[i].two->body].carrier);
  for (int i = 0; i < s->points; i++) {
    int one = s->body[s->point[i].one->body].carrier, two = s->body[s->point[i].two->body].carrier;
    s->point[i].first = first_of(s, one < 0 ? two : one);
  }
}

/* The first bounds, and what friction is laid against: by the normal forces and slips of a step without friction. */
void aim(Sim *s) {
  groups(s);
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    p->weight = weight(s, p);
    p->bound = p->push = normal_force(p);
    if (p->law->friction > 0 && p->bound < SEED * p->weight) p->bound = SEED * p->weight;
    memcpy(p->free, p->slip, 24), memcpy(p->against, p->slip, 24);
    memcpy(p->spun, p->turn, 24), memcpy(p->rolling, p->turn, 24);
  }
}

/* The share of a turn by which friction is turned, in a row of passes: all of it at first, then what would have ended the last one's
   (Aitken's relaxation). Slip that friction itself turns back, and further than it was, would never settle otherwise. */
static double share_of(const double *turn, Turning *t) {
  double change[3], size;
  for (int k = 0; k < 3; k++) change[k] = turn[k] - t->last[k];
  size = dot(change, change);
  if (!(t->share > 0)) t->share = 1;
  else if (size > 0) t->share = fmax(LEAST_TURN, fmin(1, -t->share * dot(t->last, change) / size));
  memcpy(t->last, turn, 24);
  return t->share;
}

/* What friction is laid against once more, where it would be before without it, and is now: whether that goes on by more than
   friction changed of it, and where it does, its direction now. slow: what counts as none. Raises the largest change, as the sine of
   an angle. */
static int laid_again(const double *n, const double *before, const double *now, double slow, double *against, Turning *t, double *change) {
  double left[3], old[3], fresh[3], slowed = 0, goes = 0, turn[3] = {0, 0, 0};
  for (int k = 0; k < 3; k++) left[k] = before[k] - now[k];
  if (across(n, left, old))
    for (int k = 0; k < 3; k++) slowed += left[k] * old[k];
  if (across(n, now, fresh))
    for (int k = 0; k < 3; k++) goes += now[k] * fresh[k];
  if (!(goes > slowed && goes > slow)) return t->share = 0, 0;
  if (across(n, against, old)) {
    for (int k = 0; k < 3; k++) turn[k] = fresh[k] - old[k];
    double share = share_of(turn, t);
    for (int k = 0; k < 3; k++) fresh[k] = old[k] + share * turn[k];
  }
  if (length(turn) > *change) *change = length(turn);
  across(n, fresh, against);
  return 1;
}

/* Whether the friction of a point that does not slide by a cone breaks its law: more than the normal force allows, or kept down by a
   bound of less. */
static int breaks(const Sim *s, Point *p, double push, double slow, double least) {
  double f[3], along[3], aside[3], mu = p->law->friction / (s->cone == INSCRIBED ? sqrt(2) : 1);
  force_on_first(p, f);
  direction(s, p, along);
  dCalcVectorCross3(aside, p->geom.normal, along);
  double one = fabs(dot(f, along)), two = fabs(dot(f, aside)), larger = one > two ? one : two;
  double whole = larger, most = mu * push;
  int sticks = s->cone == ELLIPTIC && fabs(dot(p->slip, along)) < slow && fabs(dot(p->slip, aside)) < slow;
  if (sticks) whole = sqrt(one * one + two * two);
  if (whole > most * (1 + STEADY) + least) {
    if (sticks) /* what holds it is laid against the force that would */
      for (int k = 0; k < 3; k++) p->against[k] = -f[k];
    return 1;
  }
  return !p->held && larger >= FULL * mu * p->bound && mu * p->bound < most * (1 - STEADY) - least;
}

/* How what is missed of bounds changed with them in each group, over points that are bound. Each counts by its bodies' weight. */
static void gather(Sim *s) {
  for (int k = 0; k < s->bodies; k++) {
    Group *g = &s->body[k].group;
    g->missed = g->change = g->back = g->moved = g->disturbed = 0;
  }
  for (int i = 0; i < s->points; i++) {
    const Point *p = s->point + i;
    Group *g = &s->body[p->first].group;
    if (!rubs(s, p->law) || p->held) continue;
    double now = normal_force(p) - p->bound, change = now - (p->push - p->was), moved = p->bound - p->was, w = 1 / (p->weight * p->weight);
    g->missed += w * now * change, g->change += w * change * change;
    g->back += w * change * moved, g->moved += w * moved * moved;
  }
}

/* The next bound of a point, by the normal forces that bounds gave: carried on to where what is missed ends, if it goes on to change
   with bounds as in the last pass (Anderson's acceleration by one pass, in each group of bodies). Where normal forces grow nearly as
   bounds do, friction and normal force may hold each other up: the point is held, by no bound, for one pass, and stays held where
   that keeps the law. Otherwise it goes on from where it was; or, where they grow faster than bounds, from the force that held it,
   since from below such bounds never come back. */
static void bound_again(Sim *s, Point *p, int open, double fall) {
  Group *g = &s->body[p->first].group;
  double push = normal_force(p), next = push;
  double along = dot(p->free, p->geom.normal), slip = sqrt(fmax(0, dot(p->free, p->free) - along * along));
  int known = g->regular > 0 && g->moved > 0;
  double rise = known ? 1 + g->back / g->moved : 0;
  if (open && p->held) p->held = 0, next = p->locks ? push : p->bound, g->disturbed = 1;
  else if (open && rise > STEEP && !p->tried && slip < FAST * fall && push > p->bound)
    p->held = p->tried = 1, p->locks = rise >= 1, p->sliding = 0, g->disturbed = 1;
  else if (known && rise < 1 && g->change > 0) {
    double on = g->missed / g->change;
    next = push - fmax(-FARTHEST, fmin(FARTHEST, on)) * (push - p->push);
  }
  p->was = p->bound;
  p->bound = next > 0 ? next : 0;
  p->push = push;
}

/* Friction once more, from the slips and normal forces of the pass that was solved. Under the elliptic cone, what slips on is given
   its bound against its slip alone, and what sticks, or slips less than friction changed in the step, keeps a pyramid with that
   bound. Whether another pass is due: friction at some point breaks its law by more than a share of STEADY. */
int aim_again(Sim *s) {
  dVector3 g;
  int due = 0;
  dWorldGetGravity(s->world, g);
  double fall = sqrt(dot(g, g)) * s->timestep, slow = SLOW * fall;
  gather(s);
  for (int i = 0; i < s->points; i++) {
    Point *p = s->point + i;
    const Law *law = p->law;
    if (!rubs(s, law)) continue;
    double push = normal_force(p), least = LEAST * p->weight, change = 0;
    double missed = fabs(push - p->bound) - STEADY * push - least;
    int slid = p->sliding, rolled = p->rolls, open = 0;
    if (law->friction > 0 && s->cone == ELLIPTIC && !p->held)
      p->sliding = laid_again(p->geom.normal, p->free, p->slip, slow, p->against, &p->bends, &change);
    if (law->rolling > 0) p->rolls = laid_again(p->geom.normal, p->spun, p->turn, 0, p->rolling, &p->curls, &change);
    if (p->sliding != slid || p->rolls != rolled || change > STEADY) open = 1;
    else if (p->sliding || law->torsional > 0 || law->rolling > 0) open = missed > 0;
    if (p->sliding != slid || p->rolls != rolled || change > TURNED) s->body[p->first].group.disturbed = 1;
    if (law->friction > 0 && !p->sliding && !slid) open |= breaks(s, p, push, slow, least);
    bound_again(s, p, open, fall);
    due |= open;
  }
  for (int k = 0; k < s->bodies; k++) {
    Group *of = &s->body[k].group;
    of->regular = of->disturbed ? 0 : of->regular + 1;
  }
  return due;
}
