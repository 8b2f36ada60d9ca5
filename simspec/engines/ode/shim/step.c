/* Steps, and what they tell of the joints' coordinates: mass matrix and accelerations by unit efforts, energy. */
#include "simspec_ode.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

void sim_listen(Sim *s);

/* One of ODE's steps from the laid bodies. Whether it was solved: ODE says of a step that it could not solve "LCP internal
   error", and leaves forces out of it. */
static int solved(Sim *s, const double *effort) {
  long said = s->messages;
  load(s, effort, 1);
  set_motors(s);
  if (s->quick) { /* shuffles its rows by ODE's one generator: seeded, a step depends on the state alone */
    dRandSetSeed(0);
    dWorldQuickStep(s->world, s->timestep);
  } else dWorldStep(s->world, s->timestep);
  return s->messages == said;
}

static void solve(Sim *s, int with_friction, const double *effort) {
  double softer = 1, nudge = 0;
  for (;;) {
    join(s, with_friction, softer, nudge);
    if (solved(s, effort)) return;
    if (softer >= MOST_SOFTER || !s->points) break;
    if (nudge > 0) softer *= 10;
    nudge = NUDGE;
    s->retries++;
    lay(s);
  }
  s->unsolved++;
}

/* Rows of what has a bound, dry friction and stops, taken out of ODE's equations, and put back. */
static void bounded(Sim *s, int on) {
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    void (*set)(dJointID) = on ? dJointEnable : dJointDisable;
    if (b->rub) set(b->rub);
    if (b->stop && b->stop != b->joint) set(b->stop);
    if (!on && b->stop && b->stop == b->joint) {
      dJointSetSliderParam(b->stop, dParamLoStop, -dInfinity);
      dJointSetSliderParam(b->stop, dParamHiStop, dInfinity);
    }
  }
}

/* Correct the velocities u that a step without contact gave by what it left over (motion.c, load_rest). */
static void refine(Sim *s, const double *effort, double *u) {
  double *acceleration = malloc((2 * s->nv + 1) * sizeof(double)), *spare = acceleration + s->nv;
  for (int i = 0; i < s->nv; i++) acceleration[i] = (u[i] - s->u[i]) / s->timestep;
  lay(s);
  load_rest(s, effort, acceleration, spare);
  bounded(s, 0);
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (b->rotor) (b->kind == HINGE ? dJointSetAMotorParam : dJointSetLMotorParam)(b->rotor, dParamVel, 0);
  }
  dWorldStep(s->world, s->timestep);
  take(s, spare);
  bounded(s, 1);
  for (int i = 0; i < s->nv; i++) u[i] += spare[i];
  free(acceleration);
}

static int rubbing(const Sim *s) {
  for (int i = 0; i < s->points; i++)
    if (rubs(s, s->point[i].law)) return 1;
  return 0;
}

/* count steps under a constant effort (nv,), 0: none. 0: done; 1: ODE refuses, see sim_text. A state that is not finite stays. */
int sim_step(Sim *s, int count, const double *effort) {
  double *u = malloc((s->nv + 1) * sizeof(double));
  sim_listen(s);
  s->armed = 1;
  if (setjmp(s->trap)) {
    s->armed = 0;
    free(u);
    return 1;
  }
  for (int k = 0; k < count && !s->lost; k++) {
    if (!s->native) {
      place(s, s->q, s->u);
      lay(s);
    }
    detect(s);
    int again = rubbing(s);
    if (again) { /* friction opposes the slip that would be without it */
      solve(s, 0, effort);
      slips(s);
      aim(s);
      lay(s);
    }
    solve(s, 1, effort);
    for (int pass = 1; again; pass++) {
      slips(s);
      if (!aim_again(s)) break;
      if (pass == MOST_PASSES) {
        s->unsettled++;
        break;
      }
      lay(s);
      solve(s, 2, effort);
    }
    s->stepped += again;
    if (s->native) {
      take_up(s);
      find_coordinates(s);
    } else {
      take(s, u);
      if (!s->points && s->jointed && !s->quick) refine(s, effort, u);
      advance_state(s, u);
    }
    for (int i = 0; i < s->nv; i++)
      if (!isfinite(s->u[i])) s->lost = 1;
    for (int i = 0; i < s->nq; i++)
      if (!isfinite(s->q[i])) s->lost = 1;
  }
  s->armed = 0;
  if (!s->lost && !s->native) {
    place(s, s->q, s->u);
    lay(s);
  }
  free(u);
  return 0;
}

void sim_set(Sim *s, const double *q, const double *u) {
  memcpy(s->q, q, s->nq * sizeof(double)), memcpy(s->u, u, s->nv * sizeof(double));
  s->points = s->lost = 0;
  for (int i = 0; i < s->nq; i++)
    if (!isfinite(q[i])) s->lost = 1;
  place(s, s->q, s->u);
  if (!s->lost) lay(s);
}

void sim_get(const Sim *s, double *q, double *u) {
  memcpy(q, s->q, s->nq * sizeof(double)), memcpy(u, s->u, s->nv * sizeof(double));
}

/* Poses (bodies, 3 + 9), the matrix by rows, and velocities (bodies, 6) of the bodies' frames. */
void sim_frames(Sim *s, double *poses, double *velocities) {
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    memcpy(poses + 12 * k, b->p, 24), memcpy(poses + 12 * k + 3, b->R, 72);
    memcpy(velocities + 6 * k, b->vo, 24), memcpy(velocities + 6 * k + 3, b->w, 24);
  }
}

/* Whether ODE adds gyroscopic torques by itself. */
static void gyroscopic(Sim *s, int on) {
  for (int k = 0; k < s->bodies; k++)
    if (s->body[k].body) dBodySetGyroscopicMode(s->body[k].body, on);
}

/* The accelerations (nv,) by ODE's step of 1 s, without contact, stops, dry friction, springs and dampers: under an effort alone
   from rest, or (effort 0) under gravity and the present velocities alone. */
int sim_accelerate(Sim *s, const double *effort, double *acceleration) {
  double *u = malloc((s->nv + 1) * sizeof(double));
  Body *kept = malloc((s->bodies + 1) * sizeof(Body));
  dVector3 gravity;
  memcpy(kept, s->body, s->bodies * sizeof(Body));
  gyroscopic(s, 0);
  dWorldGetGravity(s->world, gravity);
  memcpy(u, s->u, s->nv * sizeof(double));
  sim_listen(s);
  if (effort) {
    dWorldSetGravity(s->world, 0, 0, 0);
    memset(s->u, 0, s->nv * sizeof(double));
  }
  dJointGroupEmpty(s->joints);
  place(s, s->q, s->u);
  lay(s);
  bounded(s, 0);
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    void (*set)(dJointID, int, dReal) = b->kind == HINGE ? dJointSetAMotorParam : dJointSetLMotorParam;
    if (b->rotor) {
      set(b->rotor, dParamFMax, dInfinity);
      set(b->rotor, dParamVel, s->u[b->v]);
      set(b->rotor, dParamCFM, 1 / b->armature);
    }
  }
  load(s, effort, 0);
  long said = s->messages;
  dWorldStep(s->world, 1);
  take(s, acceleration);
  for (int i = 0; i < s->nv; i++) acceleration[i] -= s->u[i];
  bounded(s, 1);
  dWorldSetGravity(s->world, gravity[0], gravity[1], gravity[2]);
  memcpy(s->u, u, s->nv * sizeof(double));
  memcpy(s->body, kept, s->bodies * sizeof(Body));
  lay(s);
  if (s->native) gyroscopic(s, 1);
  free(kept);
  free(u);
  return s->messages != said;
}

/* Kinetic energy, and potential energy of weights and springs (J). */
void sim_energy(Sim *s, double *energy) {
  dVector3 g;
  dWorldGetGravity(s->world, g);
  energy[0] = energy[1] = 0;
  for (int k = 0; k < s->bodies; k++) {
    const Body *b = s->body + k;
    if (b->body) {
      dMass m;
      dBodyGetMass(b->body, &m);
      const dReal *p = dBodyGetPosition(b->body), *v = dBodyGetLinearVel(b->body), *w = dBodyGetAngularVel(b->body);
      dVector3 own;
      dBodyVectorFromWorld(b->body, w[0], w[1], w[2], own);
      for (int i = 0; i < 3; i++) {
        energy[0] += 0.5 * m.mass * v[i] * v[i];
        energy[1] -= m.mass * g[i] * p[i];
        for (int j = 0; j < 3; j++) energy[0] += 0.5 * own[i] * m.I[4 * i + j] * own[j];
      }
    }
    double stretch = 0;
    if (b->kind == HINGE || b->kind == SLIDE) {
      stretch = s->q[b->q] - b->rest;
      energy[0] += 0.5 * b->armature * s->u[b->v] * s->u[b->v];
    } else if (b->kind == BALL) {
      const double *q = s->q + b->q;
      stretch = 2 * atan2(sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), fabs(q[0]));
    }
    energy[1] += 0.5 * b->stiffness * stretch * stretch;
  }
}
