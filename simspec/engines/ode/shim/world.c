/* Making a world: bodies with their joints, shapes, laws of materials, filters; and what ODE says. */
#include "simspec_ode.h"
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>

static Sim *listening; /* ODE's handlers know no world: the one that is at work */

static void heard(int number, const char *text, va_list rest) {
  (void)number;
  if (!listening) return;
  listening->messages++;
  vsnprintf(listening->text, TEXT, text, rest);
}

static void failed(int number, const char *text, va_list rest) {
  heard(number, text, rest);
  if (listening && listening->armed) longjmp(listening->trap, 1);
  abort();
}

void sim_listen(Sim *s) { listening = s; }

int sim_start(void) {
  int made = dInitODE2(0);
  dAllocateODEDataForThread(~0u);
  dSetMessageHandler(heard);
  dSetErrorHandler(failed);
  dSetDebugHandler(failed);
  hulls_start();
  return made;
}

Sim *sim_new(const double *gravity, double timestep, int cone, int quick, int iterations, int native, int materials,
             int groups) {
  Sim *s = calloc(1, sizeof *s);
  if (!s) return 0;
  s->world = dWorldCreate();
  s->space = dHashSpaceCreate(0);
  s->joints = dJointGroupCreate(0);
  dWorldSetGravity(s->world, gravity[0], gravity[1], gravity[2]);
  if (!native) dWorldSetERP(s->world, 1e-300); /* bodies are laid on their joints before every step; 0 is refused */
  dWorldSetCFM(s->world, 0);
  dWorldSetAutoDisableFlag(s->world, 0);
  dWorldSetQuickStepNumIterations(s->world, iterations);
  s->timestep = timestep, s->cone = cone, s->quick = quick, s->native = native, s->contact = 1;
  s->materials = materials, s->groups = groups;
  s->law = calloc((size_t)materials * materials + 1, sizeof(Law));
  s->ignored = calloc((size_t)groups * groups + 1, 1);
  return s;
}

void sim_free(Sim *s) {
  if (listening == s) listening = 0;
  dJointGroupDestroy(s->joints);
  for (int i = 0; i < s->shapes; i++) free(s->shape[i]);
  dSpaceDestroy(s->space);
  dWorldDestroy(s->world);
  free(s->body), free(s->law), free(s->ignored), free(s->shape), free(s->point), free(s->excluded);
  free(s->q), free(s->u), free(s->start), free(s);
}

static void told(dJointID joint, void (*set)(dJointID, int, dReal)) {
  set(joint, dParamCFM, 0);
  set(joint, dParamStopERP, 1);
  set(joint, dParamStopCFM, 0);
}

/* A row of its own on a joint's axis: a joint's own motor and stop would share one. */
static dJointID axis_row(Sim *s, const Body *b, dBodyID other) {
  double a[3];
  turned(b->R, b->axis, a);
  if (b->kind == HINGE) {
    dJointID made = dJointCreateAMotor(s->world, 0);
    dJointAttach(made, b->body, other);
    dJointSetAMotorMode(made, dAMotorUser);
    dJointSetAMotorNumAxes(made, 1);
    dJointSetAMotorAxis(made, 0, 1, a[0], a[1], a[2]);
    told(made, dJointSetAMotorParam);
    return made;
  }
  dJointID made = dJointCreateLMotor(s->world, 0);
  dJointAttach(made, b->body, other);
  dJointSetLMotorNumAxes(made, 1);
  dJointSetLMotorAxis(made, 0, 1, a[0], a[1], a[2]);
  told(made, dJointSetLMotorParam);
  return made;
}

static void bind(Sim *s, Body *b) {
  const Body *above = b->parent < 0 ? 0 : s->body + b->parent;
  dBodyID other = above && above->carrier >= 0 ? s->body[above->carrier].body : 0;
  double a[3];
  turned(b->R, b->axis, a);
  if (b->kind == HINGE) {
    b->joint = dJointCreateHinge(s->world, 0);
    dJointAttach(b->joint, b->body, other);
    dJointSetHingeAnchor(b->joint, b->p[0], b->p[1], b->p[2]);
    dJointSetHingeAxis(b->joint, a[0], a[1], a[2]);
    if (b->limited) b->stop = axis_row(s, b, other);
  } else if (b->kind == SLIDE) {
    b->joint = dJointCreateSlider(s->world, 0);
    dJointAttach(b->joint, b->body, other);
    dJointSetSliderAxis(b->joint, a[0], a[1], a[2]);
    told(b->joint, dJointSetSliderParam);
    if (b->limited) b->stop = b->joint;
  } else if (b->kind == BALL) {
    b->joint = dJointCreateBall(s->world, 0);
    dJointAttach(b->joint, b->body, other);
    dJointSetBallAnchor(b->joint, b->p[0], b->p[1], b->p[2]);
  } else if (b->kind == FIXED && other) {
    b->joint = dJointCreateFixed(s->world, 0);
    dJointAttach(b->joint, b->body, other);
    dJointSetFixed(b->joint);
  }
  if (b->armature > 0) b->rotor = axis_row(s, b, other);
  if (b->dry > 0) b->rub = axis_row(s, b, other);
}

/* Bodies come parents first, at their joints' zero. numbers: damping, stiffness, rest, dry friction, armature, lower, upper. */
int sim_body(Sim *s, int kind, int parent, const double *origin, const double *axis, double mass, const double *centre,
             const double *inertia, const double *numbers, int limited) {
  Body *grown = realloc(s->body, (s->bodies + 1) * sizeof(Body));
  if (!grown) return -1;
  s->body = grown;
  Body *b = s->body + s->bodies;
  memset(b, 0, sizeof *b);
  b->kind = kind, b->parent = parent, b->q = s->nq, b->v = s->nv, b->limited = limited;
  memcpy(b->origin, origin, 24), memcpy(b->axis, axis, 24), memcpy(b->centre, centre, 24);
  matrix(origin + 3, b->turn);
  b->damping = numbers[0], b->stiffness = numbers[1], b->rest = numbers[2], b->dry = numbers[3], b->armature = numbers[4];
  b->lower = numbers[5], b->upper = numbers[6];
  static const int wide_q[] = {0, 1, 1, 4, 7}, wide_v[] = {0, 1, 1, 3, 6};
  s->nq += wide_q[kind], s->nv += wide_v[kind];
  s->q = realloc(s->q, (s->nq + 1) * sizeof(double)), s->u = realloc(s->u, (s->nv + 1) * sizeof(double));
  s->start = realloc(s->start, (s->nq + 1) * sizeof(double));
  memset(s->q + b->q, 0, wide_q[kind] * sizeof(double)), memset(s->u + b->v, 0, wide_v[kind] * sizeof(double));
  if (kind == BALL) s->q[b->q] = 1;
  if (kind == FREE) s->q[b->q + 3] = 1;
  memcpy(s->start, s->q, s->nq * sizeof(double));
  int at = s->bodies++;
  place(s, s->q, s->u);
  const Body *above = parent < 0 ? 0 : s->body + parent;
  int still = kind == FIXED && (!above || above->carrier < 0);
  b->rigid = kind != FIXED ? at : above ? above->rigid : -1;
  b->carrier = still ? -1 : mass > 0 ? at : above->carrier;
  if (still || mass <= 0) return at;
  dMass m;
  dMassSetParameters(&m, mass, 0, 0, 0, inertia[0], inertia[1], inertia[2], inertia[3], inertia[4], inertia[5]);
  b->body = dBodyCreate(s->world);
  dBodySetMass(b->body, &m);
  if (!s->native) {
    dBodySetGyroscopicMode(b->body, 0);
    dBodySetFiniteRotationMode(b->body, 1);
  }
  place(s, s->q, s->u);
  lay(s);
  bind(s, b);
  s->jointed |= b->joint != 0;
  return at;
}


/* A shape at a pose in its body's frame: sphere, box, cylinder, capsule, plane, hull, of which size are so many vertices. -1 where
   ODE has no such. */
int sim_shape(Sim *s, int body, int kind, const double *size, int vertices, const double *pose, int material, int group) {
  dGeomID g = 0;
  const Body *b = s->body + body;
  double R[9], whole[9], at[3];
  matrix(pose + 3, R);
  place(s, s->start, s->u);
  turned(b->R, pose, at);
  for (int i = 0; i < 3; i++) at[i] += b->p[i];
  multiply(b->R, R, whole);
  double n[3] = {whole[2], whole[5], whole[8]};
  switch (kind) {
    case 0: g = dCreateSphere(s->space, size[0]); break;
    case 1: g = dCreateBox(s->space, size[0], size[1], size[2]); break;
    case 2: g = dCreateCylinder(s->space, size[0], size[1]); break;
    case 3: g = dCreateCapsule(s->space, size[0], size[1]); break;
    case 4:
      if (b->carrier < 0) g = dCreatePlane(s->space, n[0], n[1], n[2], n[0] * at[0] + n[1] * at[1] + n[2] * at[2]);
      break;
    case 5: g = hull_new(s->space, size, vertices);
  }
  if (!g) return -1;
  if (kind != 4) {
    dMatrix3 turn = {whole[0], whole[1], whole[2], 0, whole[3], whole[4], whole[5], 0, whole[6], whole[7], whole[8], 0};
    if (b->carrier < 0) {
      dGeomSetPosition(g, at[0], at[1], at[2]);
      dGeomSetRotation(g, turn);
    } else { /* relative to the ODE body, whose origin is its centre of mass */
      const Body *c = s->body + b->carrier;
      double away[3] = {at[0] - c->c[0], at[1] - c->c[1], at[2] - c->c[2]}, own[3], relative[9];
      multiply_t(c->R, away, whole, own, relative);
      dMatrix3 offset = {relative[0], relative[1], relative[2], 0, relative[3], relative[4],
                         relative[5], 0, relative[6], relative[7], relative[8], 0};
      dGeomSetBody(g, c->body);
      dGeomSetOffsetPosition(g, own[0], own[1], own[2]);
      dGeomSetOffsetRotation(g, offset);
    }
  }
  Shape *made = calloc(1, sizeof *made);
  s->shape = realloc(s->shape, (s->shapes + 1) * sizeof(Shape *));
  made->geom = g, made->body = body, made->material = material, made->group = group, made->unit = s->shapes;
  dGeomSetData(g, made);
  s->shape[s->shapes] = made;
  return s->shapes++;
}

/* numbers: friction, restitution, threshold, rolling, torsional, soft_erp, soft_cfm. */
void sim_law(Sim *s, int one, int other, const double *numbers) {
  Law law = {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], 1};
  s->law[one * s->materials + other] = s->law[other * s->materials + one] = law;
}

/* What is held of it, in the same order, then the flag; NaN where the two differ by their order. */
void sim_law_values(const Sim *s, int one, int other, double *numbers) {
  const Law *a = s->law + one * s->materials + other, *b = s->law + other * s->materials + one;
  double held[] = {a->friction, a->restitution, a->threshold, a->rolling, a->torsional, a->soft_erp, a->soft_cfm, a->collide};
  memcpy(numbers, held, sizeof held);
  if (memcmp(a, b, sizeof *a)) numbers[0] = NAN;
}

void sim_ignore(Sim *s, int one, int other) {
  s->ignored[one * s->groups + other] = s->ignored[other * s->groups + one] = 1;
}

/* Pairs of bodies that do not touch, as smaller * bodies + larger, sorted. */
void sim_exclude(Sim *s, const long long *keys, int count) {
  s->excluded = malloc((count + 1) * sizeof *keys);
  memcpy(s->excluded, keys, count * sizeof *keys);
  s->excluded_count = count;
}

int sim_size(const Sim *s, int of) { return of == 0 ? s->nq : of == 1 ? s->nv : of == 2 ? s->shapes : s->points; }
dWorldID sim_world(const Sim *s) { return s->world; }
dBodyID sim_body_of(const Sim *s, int body) { return s->body[body].body; }
dGeomID sim_geom(const Sim *s, int shape) { return s->shape[shape]->geom; }
dSpaceID sim_space(const Sim *s) { return s->space; }

/* The joint, and the rows of armature, dry friction and stops. */
dJointID sim_joint(const Sim *s, int body, int which) {
  const Body *b = s->body + body;
  return which == 0 ? b->joint : which == 1 ? b->rotor : which == 2 ? b->rub : b->stop;
}

int sim_carrier(const Sim *s, int body) { return s->body[body].carrier; }

/* What forward kinematics and the efforts of joints go by: origin, axis, centre of mass; damping, stiffness, rest, dry friction,
   armature, lower, upper. 3 + 9 + 3 + 3 + 7 numbers. */
void sim_body_values(const Sim *s, int body, double *told) {
  const Body *b = s->body + body;
  double numbers[] = {b->damping, b->stiffness, b->rest, b->dry, b->armature, b->lower, b->upper};
  memcpy(told, b->origin, 24), memcpy(told + 3, b->turn, 72), memcpy(told + 12, b->axis, 24), memcpy(told + 15, b->centre, 24);
  memcpy(told + 18, numbers, sizeof numbers);
}

const char *sim_text(const Sim *s) { return s->text; }
void sim_counts(const Sim *s, long *counts) {
  const long found[] = {s->retries, s->unsolved, s->messages, s->doubtful, s->unsettled, s->stepped};
  memcpy(counts, found, sizeof found);
}

void sim_no_dry_friction(Sim *s, int body) {
  Body *b = s->body + body;
  if (b->rub) dJointDestroy(b->rub);
  b->rub = 0, b->dry = 0;
}

double sim_timestep(const Sim *s) { return s->timestep; }
void sim_set_timestep(Sim *s, double timestep) { s->timestep = timestep; }
int sim_cone(const Sim *s) { return s->cone; }
int sim_quick(const Sim *s) { return s->quick; }
int sim_native(const Sim *s) { return s->native; }
